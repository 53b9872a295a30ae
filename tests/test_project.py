"""What the project says of itself: licences, links, workflows, forms."""

import re
import runpy
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
GITHUB = ROOT / ".github"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
ADAPTERS = [
    tomllib.loads((ROOT / folder / "pyproject.toml").read_text("utf-8"))["project"]
    for folder in ("meshlab_plugin", "blender_addon")
]
long_description = runpy.run_path(str(ROOT / "build_backend.py"))["long_description"]
whole = pytest.mark.skipif(not GITHUB.is_dir(), reason="workflows are not in an sdist")


def test_the_core_is_mit_and_so_is_each_of_its_files():
    """The adapters say GPL in their first lines; nothing of that kind is among the core's."""
    own, linked = PROJECT["license-files"]
    assert (PROJECT["license"], own) == ("MIT", "LICENSE")
    assert (ROOT / own).read_text().startswith("MIT License")
    assert "Anaconda" in (ROOT / linked).read_text()  # of numba's runtime: BSD-2-Clause
    files = [p for p in (ROOT / "core").rglob("*") if p.suffix in {".py", ".pyi", ".js", ".css"}]
    assert len(files) > 150
    stated = re.compile("SPDX-License-Identifier: (?!MIT)|GNU General Public License")
    assert not [p for p in files if stated.search(p.read_text("utf-8")) and p.name != "three.js"]


@pytest.mark.parametrize("requirement", PROJECT["dependencies"])
def test_what_the_core_needs_is_free_of_the_gpl(requirement):
    """numpy and scipy name the GPL of the runtime library of gfortran, which has an exception."""
    about = metadata.metadata(re.match(r"[\w-]+", requirement)[0])
    # By get: where another package replaces what reads metadata, a missing entry is an error.
    said = " ".join([about.get("License-Expression", ""), *about.get_all("Classifier", [])])
    said = said or about.get("License", "")
    assert re.search("BSD|MIT", said), said
    assert not re.search(r"GPL(?!-3.0-or-later WITH GCC-exception)", said), said


def test_the_adapters_are_gpl_of_the_same_version_and_need_the_core():
    for adapter in ADAPTERS:
        assert adapter["license"] == "GPL-3.0-or-later"
        assert adapter["version"] == PROJECT["version"]
        assert adapter["requires-python"] == PROJECT["requires-python"]
        assert adapter["urls"]["Homepage"] == PROJECT["urls"]["Homepage"]
        (core,) = (d for d in adapter["dependencies"] if d.startswith("medialis"))
        assert core == f"medialis>={PROJECT['version']},<{int(PROJECT['version'][0]) + 1}"
        extra = PROJECT["optional-dependencies"][adapter["name"].removeprefix("medialis-")]
        assert extra[0] == core.replace("medialis", adapter["name"])


def test_links_of_the_long_description_lead_to_the_files_of_the_version():
    page = "![a](docs/a.png) [b](b.md#c) [![d](e.png)](f.md) [g](https://h.org/i) [j](#k)"
    made = long_description(page, "https://o.org/p", "1.2.3")
    blob, raw = "https://o.org/p/blob/v1.2.3", "https://o.org/p/raw/v1.2.3"
    assert made == (
        f"![a]({raw}/docs/a.png) [b]({blob}/b.md#c) [![d]({raw}/e.png)]({blob}/f.md) "
        "[g](https://h.org/i) [j](#k)"
    )
    page = (ROOT / "README.md").read_text("utf-8")
    made = long_description(page, PROJECT["urls"]["Source"], PROJECT["version"])
    assert not re.findall(r"\]\((?!https://|#)", made) and made.count("/docs/") > 20


@whole
def test_workflows_call_what_the_makefile_has():
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    workflows = sorted((GITHUB / "workflows").glob("*.yml"))
    called = [t for w in workflows for t in re.findall(r"make ([\w-]+)", w.read_text("utf-8"))]
    assert len(workflows) == 2 and len(called) >= 8
    assert set(called) <= targets


@whole
def test_workflows_test_the_pythons_that_are_promised():
    text = (GITHUB / "workflows" / "tests.yml").read_text("utf-8")
    tested = re.search(r"python: \[(.*)\]", text)[1].replace('"', "").split(", ")
    stated = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    assert tested == stated
    low, high = re.fullmatch(r">=3\.(\d+),<3\.(\d+)", PROJECT["requires-python"]).groups()
    assert stated == [f"3.{minor}" for minor in range(int(low), int(high))]


@whole
def test_wheels_are_built_for_these_pythons_and_tested_by_what_is_there():
    about = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["cibuildwheel"]
    stated = re.findall(r"Python :: 3\.(\d+)", "\n".join(PROJECT["classifiers"]))
    assert about["build"] == [f"cp3{minor}-*" for minor in stated]
    tested = re.findall(r"{project}/([\w/.]+)", " ".join(about["test-command"]))
    assert tested[0].endswith("self_test.py") and len(tested) > 5
    assert all((ROOT / path).exists() for path in tested)


@whole
def test_a_release_has_what_its_jobs_upload():
    text = (GITHUB / "workflows" / "release.yml").read_text("utf-8")
    named = {"packages", "extension", "wheels-*", "plugins-*"}
    uploaded = re.findall(r"upload-artifact@\S+\s+with:\s+name: ([\w-]+)(?:\$.*)?\n", text)
    assert {name + "*" * name.endswith("-") for name in uploaded} == named
    taken = re.findall(r"download-artifact@\S+\s+with:\s+(?:name|pattern): (\S+)\n", text)
    assert set(taken) == named and taken.count("wheels-*") == 2


def test_the_conda_recipe_asks_for_what_the_package_does():
    text = (ROOT / "core/packaging/conda/recipe.yaml").read_text("utf-8")
    assert f'version: "{PROJECT["version"]}"' in text and "medialis-${{ version }}.tar.gz" in text
    run = re.search(r"  run:\n((?:    - .*\n)+)", text)[1]
    asked = {line.strip("- \n").replace(" ", "", 1) for line in run.splitlines()[1:]}
    assert asked == {one.replace(" ", "") for one in PROJECT["dependencies"]}
    files = re.search(r"license_file:\n((?:    - .*\n)+)", text)[1].split()
    assert [one for one in files if one != "-"] == PROJECT["license-files"]
    assert all((ROOT / one).is_file() for one in PROJECT["license-files"])


@whole
def test_what_is_uploaded_is_signed():
    text = (GITHUB / "workflows" / "release.yml").read_text("utf-8")
    publish = text[text.index("  publish:") : text.index("  announce:")]
    assert "attestations: write" in publish and "id-token: write" in publish
    signed, uploaded = (publish.index(one) for one in ("attest-build-provenance", "pypi-publish"))
    assert signed < uploaded and "dist/*" in publish and "zips/*.zip" in publish
