"""Results on file: every damage is noticed, said and set aside."""

import json
import os
import random
import threading

import pytest

from refsim import InputError
from refsim.core.writing import in_turn
from refsim.io.store import read_stored, stored_bytes, tidy, write_stored

VALUES = {"label": "a run", "reading": {"value": 0.1 + 0.2, "failed": "", "steps": 12}}


def test_values_come_back_of_their_own_file_of_json(tmp_path):
    write_stored(tmp_path / "key.json", VALUES)
    assert read_stored(tmp_path / "key.json") == VALUES
    assert json.loads((tmp_path / "key.json").read_text())["reading"] == VALUES["reading"]
    assert read_stored(tmp_path / "other.json") is None
    assert read_stored(tmp_path / "key.json" / "below.json") is None
    write_stored(tmp_path / "key.json", VALUES)
    os.rename(tmp_path / "key.json", tmp_path / "other.json")
    assert read_stored(tmp_path / "other.json") is None


def test_every_flipped_bit_and_every_cut_is_noticed(tmp_path):
    file, whole = tmp_path / "key.json", stored_bytes("key.json", VALUES)
    draw = random.Random(7)
    damaged = [whole[:k] + bytes([byte ^ 1 << draw.randrange(8)]) + whole[k + 1 :] for k, byte in enumerate(whole)]
    for content in (*damaged, *(whole[:length] for length in range(len(whole))), whole + b" "):
        file.write_bytes(content)
        notes = []
        assert read_stored(file, notes) is None
        assert "is damaged" in notes[0]
        assert not file.exists()
        (tmp_path / "key.json.damaged").unlink()


@pytest.mark.parametrize("content", [b"", b"{}", b"[" * 100000, b"\xff\xfe", json.dumps(VALUES).encode()])
def test_what_was_damaged_is_set_aside_under_a_free_name(tmp_path, content):
    for name in ("key.json.damaged", "key.json.damaged2"):
        notes = []
        (tmp_path / "key.json").write_bytes(content)
        assert read_stored(tmp_path / "key.json", notes) is None
        assert notes[0].endswith(
            f"key.json is damaged (it has no digest at its beginning): it is kept as {name}, and computed anew"
        )
        assert (tmp_path / name).read_bytes() == content


@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo])
def test_what_is_no_file_gets_a_sentence(tmp_path, make):
    make(tmp_path / "key.json")
    with pytest.raises(InputError, match=r"key.json cannot be read \(.*\); move it away"):
        read_stored(tmp_path / "key.json")


def test_one_after_the_other(tmp_path):
    """And no lock stays behind."""
    inside, most = [], []

    def enter():
        with in_turn(tmp_path / "key.json.lock"):
            inside.append(1)
            most.append(len(inside))
            threading.Event().wait(0.02)
            inside.pop()

    threads = [threading.Thread(target=enter) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1] * 6
    assert not list(tmp_path.iterdir())


def test_a_result_costs_the_same_among_many(tmp_path, monkeypatch):
    """No listing of the folder, which grows with the results in it."""
    monkeypatch.setattr(os, "scandir", lambda *given: pytest.fail("the folder is listed"))
    monkeypatch.setattr(os, "listdir", os.scandir)
    write_stored(tmp_path / "a.json", {"value": 1.0})
    assert read_stored(tmp_path / "a.json") == {"value": 1.0}


@pytest.mark.parametrize("below", ["", "4f"])
def test_what_killed_writers_left_goes_when_it_is_old(tmp_path, below):
    old, young, result = (tmp_path / below / name for name in (".a.json.7.tmp", ".b.json.8.tmp", "a.json"))
    old.parent.mkdir(exist_ok=True)
    for path in (old, young, result):
        path.touch()
    for path in (old, result):
        os.utime(path, (0, 0))
    tidy(tmp_path)
    assert set(old.parent.iterdir()) == {young, result}
