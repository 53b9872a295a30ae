import numpy as np
import pytest

import medialis
from medialis.curves.curve_skeleton import CurveSkeleton


def graph():
    """A fork with a loop, an own part with one node, numbers that need all digits."""
    random = np.random.default_rng(5)
    nodes = random.normal(size=(8, 3)) / 3
    edges = [[0, 1], [1, 2], [2, 3], [3, 1], [3, 4], [5, 6]]
    importance = random.uniform(size=8)
    importance[2] = np.nan
    return CurveSkeleton.of(
        nodes, edges, random.uniform(size=8), importance=importance, vertex_node=[0, 4, -1, 7, 2]
    )


def same_graph(a, b):
    """Equal up to the order of nodes: positions and radii bit for bit."""

    def rows(g):
        return sorted(map(tuple, np.column_stack([g.nodes, g.radii]).tolist()))

    def pairs(g):
        ends = [sorted(map(tuple, g.nodes[edge].tolist())) for edge in g.edges]
        return sorted(ends)

    return rows(a) == rows(b) and pairs(a) == pairs(b)


def test_json_comes_back_bit_for_bit(tmp_path):
    before = graph()
    assert medialis.write_curve_skeleton(tmp_path / "a.json", before) == 0
    after = medialis.read_curve_skeleton(tmp_path / "a.json")
    for name in ("nodes", "edges", "radii", "importance", "branch", "vertex_node", "vertex_branch"):
        assert getattr(after, name).tobytes() == getattr(before, name).tobytes()
    text = (tmp_path / "a.json").read_bytes()
    medialis.write_curve_skeleton(tmp_path / "b.json", after)
    assert (tmp_path / "b.json").read_bytes() == text


def test_swc_cuts_loops_says_so_and_closes_them_again(tmp_path):
    before = graph()
    assert medialis.write_curve_skeleton(tmp_path / "a.swc", before) == 1
    lines = (tmp_path / "a.swc").read_text().splitlines()
    rows = [line.split() for line in lines if not line.startswith("#")]
    assert [int(row[0]) for row in rows] == list(range(1, 9))
    assert all(int(row[6]) < int(row[0]) for row in rows)
    assert sum(int(row[6]) == -1 for row in rows) == 3
    assert any("1 edges that close loops were left out" in line for line in lines)
    after = medialis.read_curve_skeleton(tmp_path / "a.swc")
    assert same_graph(before, after) and after.loops == 1
    plain = "\n".join(line for line in lines if not line.startswith("#"))
    (tmp_path / "tree.swc").write_text(plain)
    tree = medialis.read_curve_skeleton(tmp_path / "tree.swc")
    assert tree.loops == 0 and tree.component_count == before.component_count


def test_swc_makes_one_end_of_each_loop(tmp_path):
    """A ladder of three loops with a tail at each end."""
    nodes = [[x, y, 0] for x in range(9) for y in (0, 1)] + [[-1, 0, 0], [9, 0, 0]]
    sides = [(2 * x + y, 2 * x + 2 + y) for x in range(8) for y in (0, 1)]
    steps = [(2 * x, 2 * x + 1) for x in (0, 3, 5, 8)]
    edges = [*sides, *steps, (18, 0), (16, 19)]
    ladder = CurveSkeleton.of(np.array(nodes, float), np.array(edges), np.full(20, 0.1))
    assert medialis.write_curve_skeleton(tmp_path / "a.swc", ladder) == 3
    rows = np.loadtxt(tmp_path / "a.swc")
    uses = np.bincount(rows[1:, [0, 6]].astype(int).ravel(), minlength=21)
    assert (uses == 1).sum() <= len(ladder.end_points) + 3


def test_swc_of_another_program_is_read(tmp_path):
    (tmp_path / "n.swc").write_text(
        "# neuron\n\n10 1 0 0 0 2.5 -1\n12 3 1 0 0 .5 10\n 7 3 1 1 0 .5 12\n"
    )
    read = medialis.read_curve_skeleton(tmp_path / "n.swc")
    assert read.edges.tolist() == [[0, 1], [1, 2]] and read.radii.tolist() == [2.5, 0.5, 0.5]


def test_graphml_is_read_by_networkx(tmp_path):
    networkx = pytest.importorskip("networkx")
    before = graph()
    medialis.write_curve_skeleton(tmp_path / "a.graphml", before)
    read = networkx.read_graphml(tmp_path / "a.graphml")
    assert read.number_of_nodes() == 8 and read.number_of_edges() == 6
    for node, data in read.nodes(data=True):
        row = int(node[1:])
        assert [data["x"], data["y"], data["z"]] == before.nodes[row].tolist()
        assert data["radius"] == before.radii[row] and data["degree"] == before.degrees[row]
    for row, (a, b) in enumerate(before.edges.tolist()):
        data = read.edges[f"n{a}", f"n{b}"]
        assert data["branch"] == before.branch[row] and data["length"] == before.edge_lengths[row]


def test_obj_and_ply_hold_lines_and_radius(tmp_path):
    before = graph()
    medialis.write_curve_skeleton(tmp_path / "a.obj", before)
    lines = [line.split() for line in (tmp_path / "a.obj").read_text().splitlines()]
    points = [[float(word) for word in line[1:]] for line in lines if line[0] == "v"]
    assert points == before.nodes.tolist()
    assert [float(line[1]) for line in lines if line[0] == "vt"] == before.radii.tolist()
    branches = [
        [int(word.split("/")[0]) - 1 for word in line[1:]] for line in lines if line[0] == "l"
    ]
    assert branches == [row.tolist() for row in before.branches]
    medialis.write_curve_skeleton(tmp_path / "a.ply", before)
    from medialis.formats.ply_attributes import read_ply_attributes

    read = read_ply_attributes(tmp_path / "a.ply")
    assert (read.edges == before.edges).all() and (read.attributes["radius"] == before.radii).all()


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.swc", "1 0 0 0 0 1\n", "line 1 must hold seven numbers"),
        ("a.swc", "1 0 0 0 0 1 5\n", "node 5 is named"),
        ("a.swc", "1 0 0 0 0 1 -1\n1 0 0 0 0 1 -1\n", "comes twice"),
        ("a.swc", "1 0 nan 0 0 1 -1\n", "finite"),
        ("a.swc", "# nothing\n", "no node"),
        ("a.json", "{", "no JSON"),
        ("a.json", "[1]", "no medialis"),
        ("a.json", '{"format": "medialis curve skeleton", "nodes": 1}', "damaged"),
    ],
)
def test_damaged_files_give_a_sentence(tmp_path, name, content, text):
    (tmp_path / name).write_text(content)
    with pytest.raises(medialis.InvalidShapeError, match=text):
        medialis.read_curve_skeleton(tmp_path / name)


def test_other_endings_give_a_sentence(tmp_path):
    with pytest.raises(medialis.InvalidOptionError, match=r"\.swc"):
        medialis.write_curve_skeleton(tmp_path / "a.txt", graph())
    with pytest.raises(medialis.InvalidOptionError, match=r"\.json or \.swc"):
        medialis.read_curve_skeleton(tmp_path / "a.ply")
    with pytest.raises(medialis.FileError):
        medialis.read_curve_skeleton(tmp_path / "missing.swc")
