"""Files of pairs and seeds that hold anything but numbers, or are no files."""

import os

import pytest

import closed_forms as forms
import medialis

OPTIONS = {
    "pairs": ("geodesic_path", {}),
    "add_seeds": ("mean_shift_segments", {"seeds": "none"}),
    "remove_seeds": ("mean_shift_segments", {}),
}


def run(option, path):
    operation, options = OPTIONS[option]
    return medialis.run(operation, forms.icosphere(2), **options, **{option: str(path)})


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize("digits", [20, 5000])
@pytest.mark.parametrize("sign", ["", "-"])
def test_numbers_of_any_length_give_a_sentence(tmp_path, option, digits, sign):
    """A vertex number of 20 digits raised OverflowError, one of 5,000 ValueError (fixed)."""
    path = tmp_path / "a.txt"
    path.write_text(f"0 1\n0 {sign}{'7' * digits}\n" if option == "pairs" else sign + "7" * digits)
    with pytest.raises(medialis.InvalidOptionError, match="Line") as error:
        run(option, path)
    assert len(str(error.value)) < 500


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize("content", ["² ³\n", "²\n", "0x1 0x2\n", "1_0 1_1\n", "1e3 1e400\n"])
def test_words_that_look_like_numbers_give_a_sentence(tmp_path, option, content):
    """Superscripts are digits to Python, and raised ValueError (fixed)."""
    path = tmp_path / "a.txt"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(medialis.InvalidOptionError, match="Line 1"):
        run(option, path)


@pytest.mark.parametrize("option", OPTIONS)
def test_bytes_that_are_no_text_give_a_sentence(tmp_path, option):
    """Bytes that are no UTF-8 raised UnicodeDecodeError (fixed)."""
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(medialis.FileError, match="no text"):
        run(option, path)


@pytest.mark.skipif(os.name == "nt", reason="needs pipes and devices of Unix")
@pytest.mark.parametrize("option", OPTIONS)
def test_pipes_and_devices_are_refused(tmp_path, option):
    """Seeds from /dev/zero filled the memory, and a named pipe was waited for (fixed)."""
    os.mkfifo(tmp_path / "pipe.txt")
    for path in (tmp_path / "pipe.txt", "/dev/zero", tmp_path):
        with pytest.raises(medialis.MedialisError, match=r"regular file|folder"):
            run(option, path)
