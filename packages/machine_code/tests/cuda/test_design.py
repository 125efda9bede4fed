"""Designs of the kernel of flights."""

from rans_machine_code.cuda.design import Design

from tests.support.engines import PLATFORM
from tests.support.kernel_flights import policy


def test_designs_of_shipped_sizes():
    """What a block of an H200 has room for: 227 KiB."""

    def design(layers, history=0):
        given = policy(PLATFORM, layers=layers, zoom=16.0, history=history).architecture
        return Design(given, 1, 232448)

    small = design((64, 64))
    large = design((256, 256))
    wide = design((256, 256), 12)
    assert (small.warps, small.tiles, small.kept) == (16, 2, small.places["end"])
    # 8 warps of 32 threads share 65,536 registers, 256 each: 136 of them hold the first layer's activations.
    assert (large.warps, large.kept) == (8, large.places["end"])
    # 16 + 12 * 16 inputs: 208 x 256 and 256 x 256 numbers of two bytes do not fit beside the inputs.
    assert wide.columns == 208
    assert wide.kept < wide.places["end"]
    assert wide.used <= 232448
