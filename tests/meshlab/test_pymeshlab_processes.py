"""What only a fresh process shows: import orders, no patching, the tutorial scripts."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "docs" / "examples").glob("pymeshlab_*.py"))

RUN = """
import numpy as np
ms = pymeshlab.MeshSet()
shape = medialis.organic_shape(56)
ms.add_mesh(pymeshlab.Mesh(shape.points, shape.faces))
found = ms.generate_surface_skeleton()
assert found["skeleton_points"] > 1000, found
ms.compute_scalar_by_function_per_vertex(q="radius")
print("done")
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "imports",
    [
        "import medialis_meshlab, pymeshlab, medialis, numba, scipy.spatial, scipy.sparse.csgraph",
        "import numba, scipy.spatial, scipy.sparse.csgraph, medialis, pymeshlab, medialis_meshlab",
        "import pymeshlab, medialis, medialis_meshlab",
        "import medialis\nmedialis.run('surface_skeleton', medialis.organic_shape(56))\n"
        "import medialis_meshlab, pymeshlab",
    ],
    ids=["first", "last", "after pymeshlab", "after computing"],
)
def test_any_order_of_imports(fresh, imports):
    """pymeshlab's own libraries break others in some orders (PyMeshLab issue 444)."""
    assert fresh(imports + RUN).strip() == "done"


def test_the_core_does_not_import_pymeshlab(fresh):
    assert fresh("import medialis, sys; print('pymeshlab' in sys.modules)").strip() == "False"


def test_licences_are_kept_apart():
    """The core (MIT) names no module of the adapters or of pymeshlab; the adapters say GPL."""
    for path in (ROOT / "core").rglob("*.py"):
        assert not re.search(
            r"^\s*(import|from) (pymeshlab|medialis_mesh)", path.read_text(encoding="utf-8"), re.M
        ), path
    adapters = [*(ROOT / "meshlab_plugin").glob("medialis_*/*.py")]
    assert len(adapters) > 5
    for path in adapters:
        first = path.read_text(encoding="utf-8").splitlines()[0]
        assert first == "# SPDX-License-Identifier: GPL-3.0-or-later", path


@pytest.mark.slow
def test_the_subclass_patches_nothing(fresh):
    code = """
import pymeshlab
before = dict(vars(pymeshlab.MeshSet))
from medialis_meshset import MeshSet, filter_list
import medialis
ms = MeshSet()
shape = medialis.organic_shape(56)
ms.add_mesh(pymeshlab.Mesh(shape.points, shape.faces))
assert ms.generate_surface_skeleton(importance=False)["layers"] == {"surface_skeleton": 1}
ms.set_current_mesh(0)
made = ms.apply_filter("generate_surface_skeleton", importance=False)
assert made["layers"] == {"surface_skeleton": 2}
assert ms.get_geometric_measures() and "refine" in ms.filter_parameter_values(filter_list()[-1])
assert dict(vars(pymeshlab.MeshSet)) == before
import medialis_meshlab
assert hasattr(pymeshlab.MeshSet, "generate_surface_skeleton")
medialis_meshlab.patch()
medialis_meshlab.unpatch()
assert dict(vars(pymeshlab.MeshSet)) == before
assert ms.generate_surface_skeleton(importance=False)["layers"] == {"surface_skeleton": 3}
print("done")
"""
    assert fresh(code).strip() == "done"


@pytest.mark.parametrize("version", ["2022.2.post4", "2023.12", "2023.12.post1"])
def test_a_pymeshlab_that_crashes_is_refused_before_it_is_loaded(fresh, tmp_path, version):
    (tmp_path / "pymeshlab.py").write_text("import os\nos.abort()\n")
    about = tmp_path / f"pymeshlab-{version}.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: pymeshlab\nVersion: {version}\n")
    code = "import sys; sys.path.insert(0, sys.argv[1])\nimport medialis_meshlab"
    done = fresh(code, tmp_path, check=False)
    sentence = f"needs pymeshlab 2023.12.post2 or later, got {version}, which crashes with numpy 2"
    assert done.returncode == 1 and sentence in done.stderr.splitlines()[-1]


@pytest.mark.parametrize("package", ["medialis_meshlab", "medialis_meshset"])
def test_without_pymeshlab_one_sentence_says_what_to_install(fresh, package):
    code = f"import sys; sys.modules['pymeshlab'] = None\nimport {package}"
    done = fresh(code, check=False)
    assert done.returncode == 1
    assert done.stderr.strip().endswith("not installed: pip install medialis-meshlab")


@pytest.mark.slow
@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_tutorial_scripts_run(fresh, script, tmp_path):
    printed = fresh(script.read_text(encoding="utf-8"), cwd=tmp_path)
    assert printed.strip() and [*tmp_path.iterdir()]
