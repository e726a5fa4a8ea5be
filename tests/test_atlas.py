"""The quadtree atlas: by hand, and as a state machine beside a plain map of texels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, invariant, multiple, rule

from froxel_ref.atlas import Atlas, Tile, allocate, free, largest_free, new_atlas, reset, tile_size_for
from froxel_ref.records import InputError


def same(a: Atlas, b: Atlas) -> bool:
    return a[:2] == b[:2] and a.tiles == b.tiles and all(
        np.array_equal(x, y) for x, y in zip(a.room, b.room, strict=True))


def test_tiles_by_hand() -> None:
    """256² in tiles of 64 and more: corners first, as the quarters are numbered."""
    atlas = new_atlas(256, 64)
    got = []
    for wanted in (64, 128, 64, 64, 64, 128, 1, 128, 64):
        atlas, tile = allocate(atlas, wanted)
        got.append(None if tile is None else tuple(tile))
    assert got == [(0, 0, 64), (0, 128, 128), (0, 64, 64), (64, 0, 64), (64, 64, 64), (128, 0, 128), (128, 128, 64),
                   None, (128, 192, 64)]
    assert largest_free(atlas) == 64
    # A middle one goes and the same place is found again.
    atlas, tile = allocate(free(atlas, Tile(0, 64, 64)), 33)
    assert tile == Tile(0, 64, 64)


def test_a_request_for_everything() -> None:
    atlas, tile = allocate(new_atlas(2048), 1025)
    assert tile == Tile(0, 0, 2048)
    assert largest_free(atlas) == 0
    again, none = allocate(atlas, 1)
    assert none is None
    assert again is atlas
    assert same(free(atlas, tile), new_atlas(2048))


def test_a_request_beyond_everything() -> None:
    atlas = new_atlas(256, 64)
    assert allocate(atlas, 257) == (atlas, None)


def test_an_atlas_of_one_tile() -> None:
    atlas, tile = allocate(new_atlas(64, 64), 3)
    assert tile == Tile(0, 0, 64)
    assert allocate(atlas, 3)[1] is None
    assert same(free(atlas, tile), new_atlas(64, 64))


def test_nothing_is_changed_in_place() -> None:
    empty = new_atlas(256, 64)
    one, tile = allocate(empty, 64)
    two, _ = allocate(one, 128)
    free(two, tile)
    assert same(empty, new_atlas(256, 64))
    assert same(one, allocate(new_atlas(256, 64), 64)[0])


@pytest.mark.parametrize(("size", "smallest", "words"), [
    (100, 64, "size: is 100, must be a power of two"), (256, 48, "smallest: is 48"), (0, 1, "size: is 0"),
    (64, 128, "smallest: is 128, must be at most"), (-4, 1, "size: is -4")])
def test_bad_sizes(size: int, smallest: int, words: str) -> None:
    with pytest.raises(InputError, match=words):
        new_atlas(size, smallest)


def test_bad_tiles_and_requests() -> None:
    atlas, tile = allocate(new_atlas(256, 64), 64)
    for other in (Tile(64, 64, 64), Tile(0, 0, 128), Tile(-64, 0, 64)):
        with pytest.raises(InputError, match=r"tile: is .* must be one that is taken"):
            free(atlas, other)
    with pytest.raises(InputError, match="must be one that is taken"):
        free(free(atlas, tile), tile)
    with pytest.raises(InputError, match="wanted: is 0"):
        allocate(atlas, 0)


class AtlasMachine(RuleBasedStateMachine):
    """Beside the atlas a map of its smallest tiles that says what is taken, and a search of all squares."""

    tiles = Bundle("tiles")

    def __init__(self) -> None:
        super().__init__()
        self.atlas = new_atlas(512, 32)
        self.taken = np.zeros((16, 16), bool)  # a cell is one smallest tile

    def room(self, size: int) -> bool:
        """Whether an aligned square of this size is free: by looking at all of them."""
        cells = size // 32
        return cells <= 16 and not self.taken.reshape(16 // cells, cells, 16 // cells, cells).any(axis=(1, 3)).all()

    @rule(target=tiles, wanted=st.one_of(st.integers(1, 600), st.sampled_from([32, 33, 64, 128, 256, 512])))
    def allocate(self, wanted: int) -> object:
        before, size = self.atlas, tile_size_for(self.atlas, wanted)
        self.atlas, tile = allocate(before, wanted)
        if tile is None:
            assert not self.room(size)
            assert same(self.atlas, before)
            return multiple()
        assert tile.size == size >= wanted
        assert size < 2 * max(wanted, 32)
        assert tile.row % size == tile.column % size == 0
        cells = tuple(slice(at // 32, (at + size) // 32) for at in (tile.row, tile.column))
        assert max(tile.row, tile.column) + size <= 512
        assert not self.taken[cells].any()  # no overlap
        self.taken[cells] = True
        return tile

    @rule(tile=consumes(tiles))
    def give_back(self, tile: Tile) -> None:
        self.atlas = free(self.atlas, tile)
        cells = tuple(slice(at // 32, (at + tile.size) // 32) for at in (tile.row, tile.column))
        assert self.taken[cells].all()
        self.taken[cells] = False

    @rule()
    def empty_again(self) -> None:
        """Whatever is given back last, nothing is lost: the atlas equals a new one."""
        atlas = self.atlas
        for tile in sorted(atlas.tiles):
            atlas = free(atlas, tile)
        assert same(atlas, new_atlas(512, 32))
        assert same(reset(self.atlas), atlas)

    @invariant()
    def largest_is_right(self) -> None:
        want = next((size for size in (512, 256, 128, 64, 32) if self.room(size)), 0)
        assert largest_free(self.atlas) == want

    @invariant()
    def nothing_is_lost(self) -> None:
        assert sum(tile.size**2 for tile in self.atlas.tiles) == int(self.taken.sum()) * 32 * 32


TestAtlas = AtlasMachine.TestCase
TestAtlas.settings = settings(max_examples=60, stateful_step_count=60, deadline=None)
