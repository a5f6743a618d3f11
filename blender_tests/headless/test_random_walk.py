"""Operations in random order: no traceback, nothing that runs on, and a file that keeps itself."""

import pytest
from random_walk import Walk, check_kept


@pytest.mark.interface
@pytest.mark.computes
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.logic)])
def test_a_random_walk_ends_with_a_file_that_keeps_itself(addon, module, tmp_path, seed):
    walk = Walk(addon, module, tmp_path, seed)
    walk.take(140)
    assert walk.counts["morph"] > 2
    check_kept(tmp_path / "end.blend")
