"""Springs under the force law of the compiled steps, without time."""

import numpy as np

from labpipe.contact.impact._steps import Block, contact_radius, force


def elastic_force(springs, approach):
    """Force, slope and contact radius for a unit contact modulus."""
    n, gap = springs.position.size, springs.gap
    none, moments = np.zeros((0, n)), np.concatenate([[0.0], np.cumsum(springs.weight * gap)])
    block = Block(
        gap=gap,
        weight=springs.weight,
        position=springs.position,
        last_weight=springs.last_weight,
        total=np.concatenate([[0.0], np.cumsum(springs.weight)]),
        edge_bias=springs.edge_bias,
        memory=none,
        inverse=np.zeros(0),
        load=np.zeros(n),
        displacement=np.zeros(n),
        reach=gap,
        moments=moments,
        new_load=np.zeros(n),
        new_displacement=np.zeros(n),
    )
    return *force(block, approach), contact_radius(block, approach)
