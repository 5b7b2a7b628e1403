"""What makes a radius uncertain, part by part."""

from labpipe.imaging.radius_results import _edge_systematic


def test_of_an_edge_only_the_scale_is_uncertain() -> None:
    parts = _edge_systematic(1e-3, None, None, {"pixel_size": 2e-3})  # type: ignore[arg-type]
    assert parts.tolist() == [0.0, 0.0, 2e-6, 0.0]
