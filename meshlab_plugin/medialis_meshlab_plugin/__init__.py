# SPDX-License-Identifier: GPL-3.0-or-later
"""The plugin of MeshLab's filter menu, as files: which there are and where they belong.

What is written in C++ is in `filter_medialis`, and what is built of it comes with this distribution
(`medialis_meshset/plugins`). `install` is what `medialis meshlab-install` does: built plugins and a
machine in, the plugin in MeshLab's folder out, with what the core writes beside it
(`medialis.hosts.write_notes`). Apart from the filters of pymeshlab, which need it installed: this
does not. How MeshLab looks for plugins is said in `medialis/hosts/machine.py`.
"""
