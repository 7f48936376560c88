"""A situation is data."""

from __future__ import annotations

import pytest
from rig import Rig


def test_a_field_that_no_situation_has_cannot_be_changed() -> None:
    with pytest.raises(AssertionError, match="folowing"):
        Rig().now.but(folowing=None)
