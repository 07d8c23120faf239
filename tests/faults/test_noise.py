"""Damaged frames are the same for the same seed, and of every kind."""

from __future__ import annotations

from .noise import damaged

GOOD = [bytes(range(40)), b"short"]


def test_the_same_seed_damages_alike() -> None:
    assert list(damaged(7, 200, GOOD)) == list(damaged(7, 200, GOOD))
    assert list(damaged(7, 200, GOOD)) != list(damaged(8, 200, GOOD))


def test_frames_are_cut_lengthened_and_changed() -> None:
    frames = list(damaged(7, 500, GOOD))
    assert any(GOOD[0].startswith(frame) and len(frame) < 40 for frame in frames)
    assert any(frame.startswith(GOOD[0]) and len(frame) > 40 for frame in frames)
    assert any(len(frame) == 40 and frame != GOOD[0] for frame in frames)
    assert b"" in frames
