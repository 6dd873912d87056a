"""What the papers' own choices give: the page shows the record, and the record names what the preset takes."""

import json
import re

import pytest

from refsim.core.effect import EFFECTS
from validation import own_choices

STORED = json.loads(own_choices.STORED.read_text())


def test_the_page_shows_what_was_measured():
    text = own_choices.PAGE.read_text()
    assert own_choices.page(text, STORED) == text
    assert list(STORED) == list(own_choices.ROWS)


def test_rows_name_what_the_preset_takes():
    for source, effects, _, _ in own_choices.ROWS.values():
        taken = {e for name in re.findall(r"\w+", effects) for e in EFFECTS[name].improvements}
        assert taken - {"E7"} <= set(re.findall(r"[EMP]\d+", source))  # E7 is of the plane


@pytest.mark.slow
@pytest.mark.parametrize("name", own_choices.ROWS)
def test_the_record_is_what_is_measured(name):
    for literal, stored in (((), STORED[name]["refsim"]), (("paper",), STORED[name]["paper"])):
        found = own_choices.ROWS[name][-1](literal)
        assert found["remark"] == stored["remark"]
        assert found["value"] == pytest.approx(stored["value"], rel=1e-3)
