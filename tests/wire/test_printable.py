"""What others wrote does not move the cursor."""

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wire.printable import printable, printable_lines

DANGEROUS = [
    *map(chr, range(0x20)),
    *map(chr, range(0x7F, 0xA0)),
    *"\u061c\u200e\u200f\u2028\u2029\u202d\u202e\u2066\u2069",
]


@pytest.mark.parametrize("character", [*DANGEROUS, "\ud800"], ids=ascii)
def test_a_dangerous_character_becomes_an_escape(character):
    escape = character.encode("unicode_escape").decode()
    assert printable(f"a{character}b") == f"a{escape}b"
    assert printable_lines(f"a{character}b\nc") == (f"a{character}b\nc" if character == "\n" else f"a{escape}b\nc")


@given(st.text(st.characters()))
def test_what_remains_is_printable_and_can_be_written(text):
    told = printable(text)
    assert {unicodedata.category(each) for each in told} & {"Cc", "Cf", "Cs", "Zl", "Zp"} == set()
    told.encode()
    assert printable(told) == told


@pytest.mark.parametrize("text", ["", "fitness 0.25, at link 2", "± 0,5 m² → ▀▀ Çağ 模 𝔸"])
def test_what_people_write_stays(text):
    assert printable(text) == printable_lines(text) == text
