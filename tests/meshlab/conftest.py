"""Fixtures of the pymeshlab filters: a MeshSet with a mesh, and operations made for a test."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import field, make_dataclass
from pathlib import Path
from typing import Any

import pytest

import medialis
from medialis.base.options import Options
from medialis.operations import registry
from medialis.operations.declaration import Operation
from medialis.operations.result import Outcome

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def creature() -> medialis.Shape:
    return medialis.organic_shape(56)


@pytest.fixture
def mesh_set(creature):
    pymeshlab = pytest.importorskip("pymeshlab", reason="needs pymeshlab (the extra meshlab)")
    import medialis_meshlab

    medialis_meshlab.patch()
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(creature.points, creature.faces), "Größe 形")
    return ms


@pytest.fixture
def register(monkeypatch):
    """Function that registers an operation and makes a filter of it, for one test."""
    pytest.importorskip("pymeshlab", reason="needs pymeshlab (the extra meshlab)")
    import medialis_meshlab

    medialis_meshlab.unpatch()

    def add(*layers, name=None, parameters=(), run=None, images=None, needs_faces=False):
        if name is None:  # fields on the given mesh have colours where nothing is generated
            here = [layer for layer in layers if callable(layer) or layer.on_input]
            name = "compute_made" if layers and len(here) == len(layers) else "generate_made"

        def outcome(shape, values, progress):
            made = [layer(shape) if callable(layer) else layer for layer in layers]
            progress.note("Made by hand.")
            return Outcome(shape, tuple(made), {"count": len(made)}, images=images or {})

        fields = [
            (p.name, Any, field(default=p.default, metadata={"parameter": p})) for p in parameters
        ]
        own = Operation(
            name=name.partition("_")[2],
            filter_name=name,
            label="Made",
            group="Test",
            help="Make layers by hand.",
            options=make_dataclass("MadeRun", fields, bases=(Options,), frozen=True, kw_only=True),
            run=run or outcome,
            needs_faces=needs_faces,
        )
        monkeypatch.setattr(registry, "OPERATIONS", (*registry.OPERATIONS, own))
        monkeypatch.setattr(medialis, "OPERATIONS", registry.OPERATIONS)
        medialis_meshlab.patch()
        return own

    yield add
    medialis_meshlab.unpatch()
    monkeypatch.undo()
    medialis_meshlab.patch()


@pytest.fixture
def fresh():
    """Function that runs Python code in a process of its own and returns what it printed."""
    pytest.importorskip("pymeshlab", reason="needs pymeshlab (the extra meshlab)")

    def run(code, *arguments, check=True, **more):
        paths = [ROOT / "core", ROOT / "meshlab_plugin"]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))}
        done = subprocess.run(
            [sys.executable, "-X", "faulthandler", "-W", "error", "-c", code, *map(str, arguments)],
            capture_output=True,
            text=True,
            encoding="utf-8",
            env={**environment, "PYTHONIOENCODING": "utf-8"},
            timeout=300,
            **more,
        )
        if check:
            assert done.returncode == 0, done.stderr
            return done.stdout
        return done

    return run
