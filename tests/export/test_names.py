"""Identifiers are a bijection, and harmless."""

from __future__ import annotations

import re

import pytest
from export.corpus import names
from hypothesis import example, given
from hypothesis import strategies as st

from smv_planner.export.names import RESERVED, Sort, identifier, original

ANY_NAME = st.text() | st.text(st.sampled_from("az_.-/xz0 Z")) | st.sampled_from(names())


@given(ANY_NAME, st.sampled_from(Sort))
@example("", Sort.VARIABLE)
def test_a_name_comes_back(name: str, sort: Sort) -> None:
    text = identifier(sort, name)
    assert original(text) == (sort, name)
    assert re.fullmatch(r"[a-z]_[A-Za-z0-9_]*", text)
    assert text not in RESERVED


@given(ANY_NAME, ANY_NAME, st.sampled_from(Sort), st.sampled_from(Sort))
def test_different_names_have_different_identifiers(name: str, other: str, sort: Sort, another: Sort) -> None:
    assert (identifier(sort, name) == identifier(another, other)) == ((sort, name) == (another, other))


def test_hostile_names_have_different_identifiers() -> None:
    identifiers = {identifier(sort, name) for sort in Sort for name in names()}
    assert len(identifiers) == len(Sort) * len(names())
    assert not identifiers & RESERVED
    assert len(names()) >= len(RESERVED) + 200


@given(st.text(st.sampled_from("vkx_zud.A0-")) | st.from_regex(r"[vkx]_(_|z|zx[0-9a-f]*_|zu|[A-Za-z0-9])*"))
def test_what_is_read_as_a_name_is_written_as_the_same_identifier(text: str) -> None:
    try:
        sort, name = original(text)
    except ValueError:
        return
    assert identifier(sort, name) == text


@pytest.mark.parametrize(
    "text", ["", "v", "v_", "_v", "q_a", "v__a", "v_a__", "v_a.b", "v__zx41_", "v__zx110000_", "v__z", "v_a-b"]
)
def test_other_texts_are_no_identifiers_of_ours(text: str) -> None:
    with pytest.raises(ValueError, match="not an identifier of ours"):
        original(text)


@pytest.mark.parametrize(
    ("name", "text"), [("r1.pos_m", "v_r1__pos_m"), ("on", "v_on"), ("pos-3", "v__poszm3"), ("x; y", "v__xzx3b_zx20_y")]
)
def test_plain_names_stay_readable(name: str, text: str) -> None:
    assert identifier(Sort.VARIABLE, name) == text
