"""The decorator that runs cases in one test."""

import pytest

from tests.each import each


def test_all_failures_are_reported_with_their_names(tmp_path):
    seen = []

    @each("a", [1, 2, pytest.param(3, id="three")])
    @each("b", [10, 20], ids=["ten", "twenty"])
    def check(a, b, tmp_path):
        seen.append((a, b))
        (tmp_path / "new").mkdir()
        assert (a, b) != (1, 20)
        with pytest.raises(ValueError):
            int("x" if a < 3 else "1")

    with pytest.raises(BaseExceptionGroup, match="2 of 3 cases") as caught:
        check(tmp_path=tmp_path)
    assert seen == [(a, b) for a in (1, 2, 3) for b in (10, 20)]
    first, last = caught.value.exceptions
    assert first.__notes__ == ["case 0: 1"] and last.__notes__ == ["case 2: three"]
    assert [error.__notes__ for error in last.exceptions] == [["case 0: ten"], ["case 1: twenty"]]


def test_a_skipped_case_is_told():
    @each("a", [1, 2])
    def check(a, of):
        if a in of:
            pytest.skip("not here")

    with pytest.warns(UserWarning, match="1 of 2 cases skipped: not here"):
        check(of=(1,))
    with pytest.raises(pytest.skip.Exception):
        check(of=(1, 2))
