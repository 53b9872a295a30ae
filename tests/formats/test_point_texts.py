"""Points as programs of several countries write them, with headings, gaps and decimal commas."""

import numpy as np
import pytest

import medialis
from medialis.formats.meshes import read_mesh
from medialis.formats.point_texts import parse_point_text

ONE_TWO = [[1.5, -2.25, 3.0], [4.0, 5.5, -6.0]]


def text_of(rows, between, decimal=".", heading=""):
    """Write rows of numbers."""
    lines = [between.join(f"{value:.2f}".replace(".", decimal) for value in row) for row in rows]
    return (heading + "".join(line + "\n" for line in lines)).encode()


@pytest.mark.parametrize("between", [";", "; ", "\t", " ", "   "])
@pytest.mark.parametrize("heading", ["", "x;y;z\n", "# measured\n"])
def test_decimal_commas_are_no_columns(between, heading):
    """`5,12;9,50;1,44` became x = 5, y = 12, z = 9 (fixed)."""
    heading = heading.replace(";", between)
    mesh = parse_point_text(text_of(ONE_TWO, between, ",", heading))
    assert mesh.points.tolist() == ONE_TWO


@pytest.mark.parametrize("between", [",", ", ", ";", "\t", " ", " , "])
def test_decimal_points_take_any_mark_between_columns(between):
    assert parse_point_text(text_of(ONE_TWO, between)).points.tolist() == ONE_TWO


@pytest.mark.parametrize("text", ["1.234,5;2,5;3\n", "1,234.5 2,345.5 3.0\n"])
def test_numbers_that_can_be_read_in_two_ways_are_refused(text):
    with pytest.raises(medialis.InvalidShapeError, match="decimal points"):
        parse_point_text(text.encode())


@pytest.mark.parametrize(
    ("heading", "position", "normal"),
    [
        ("id,x,y,z", (1, 2, 3), None),
        ("z,y,x", (2, 1, 0), None),
        ("nx,ny,nz,x,y,z", (3, 4, 5), (0, 1, 2)),
        ('"Points:0","Points:1","Points:2"', (0, 1, 2), None),
        ('"Normals:0","Normals:1","Normals:2","Points:0","Points:1","Points:2"', (3, 4, 5),
         (0, 1, 2)),
        ("X [mm],Y [mm],Z [mm],Temperature (K)", (0, 1, 2), None),
        ("vx,vy,vz,pos_x,pos_y,pos_z", (3, 4, 5), None),
        ("normal_x,x_coord,normal_y,y_coord,normal_z,z_coord", (1, 3, 5), (0, 2, 4)),
        (",x,y,z", (1, 2, 3), None),
    ],
)  # fmt: skip
def test_a_heading_names_the_columns(heading, position, normal):
    """It was passed over, and the first three were taken (fixed)."""
    rows = np.arange(1.0, 1 + 4 * (heading.count(",") + 1)).reshape(4, -1)
    for between in ",;\t":
        mesh = parse_point_text(text_of(rows, between, ".", heading.replace(",", between) + "\n"))
        assert np.array_equal(mesh.points, rows[:, position])
        assert (mesh.normals is None) == (normal is None)
        assert normal is None or np.array_equal(mesh.normals, rows[:, normal])
        assert mesh.messages[0].code == "heading"


def test_a_comment_names_the_columns_where_it_fits():
    """As CloudCompare writes it."""
    heading = b"//X Y Z R G B Nx Ny Nz\n"
    mesh = parse_point_text(heading + b"1 2 3 255 0 0 0 0 1\n4 5 6 255 0 0 0 0 1\n")
    assert mesh.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert mesh.normals.tolist() == [[0, 0, 1]] * 2
    assert parse_point_text(b"# z y x\n1 2 3\n").points.tolist() == [[3, 2, 1]]
    assert parse_point_text(b"# z y x\n1 2 3 4\n").points.tolist() == [[1, 2, 3]]
    assert parse_point_text(b"# from x to z\n1 2 3\n").points.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("id;east;north;height\n1;2;3;4\n", "which columns are x, y and z"),
        ("x,y\n1,2,3\n", "which columns are x, y and z"),
        ("x,y,z\n1,2,3,4\n", "names 3 columns, but its lines have 4 numbers"),
        ("x,y,z,t\n1,2,3\n4,5,6,7\n", "names 4 columns, but its lines have 3 to 4 numbers"),
    ],
)
def test_a_heading_that_leaves_it_open_is_refused(text, words):
    with pytest.raises(medialis.InvalidShapeError, match=words):
        parse_point_text(text.encode())


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_an_empty_field_shifts_no_row(mark):
    """The numbers after it became those of other columns (fixed)."""
    rows = [("1", "2", "3", "4"), ("5", "", "7", "8"), ("", "2", "3", "4"), ("1", "2", "3", "")]
    text = "".join(mark.join(row) + "\n" for row in rows)
    points = parse_point_text(text.encode()).points
    nan = float("nan")
    expected = [[1, 2, 3], [5, nan, 7], [nan, 2, 3], [1, 2, 3]]
    np.testing.assert_array_equal(points, expected)


def test_marks_at_the_ends_of_all_lines_are_no_columns():
    assert parse_point_text(b"1,2,3,\n4,5,6,\n").points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert parse_point_text(b"1\t\t2\t\t3\n4\t\t5\t\t6\n").points.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_points_with_gaps_are_left_out_of_the_shape(tmp_path):
    good = medialis.organic_shape(56).points
    rows = [f"{x!r},{y!r},{z!r}" for x, y, z in good.tolist()]
    rows[7] = rows[7].split(",")[0] + ",,0.5"
    (tmp_path / "a.csv").write_text("x,y,z\n" + "\n".join(rows) + "\n")
    mesh = read_mesh(tmp_path / "a.csv")
    assert np.isnan(mesh.points[7]).tolist() == [False, True, False]
    assert np.array_equal(np.delete(mesh.points, 7, axis=0), np.delete(good, 7, axis=0))


def test_a_heading_of_brackets_is_looked_at_in_linear_time():
    """200,000 of them took minutes (fixed before it was released)."""
    mesh = parse_point_text(b"x(" + b"(" * 200_000 + b"\n1 2 3\n")
    assert mesh.points.tolist() == [[1, 2, 3]] and len(str(mesh.messages[0])) < 200
