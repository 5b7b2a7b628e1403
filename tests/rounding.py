"""What rounding may leave between two ways to the same number, on any processor.

An operation in double precision errs by at most half an eps of its result, an exponential or a power by some. So n
operations leave at most n eps of the largest number on the way (Higham 2002, Accuracy and Stability of Numerical
Algorithms, section 3.1), whatever order a processor adds in and whether it fuses a product with a sum. Where a small
difference of large numbers is taken, that largest number is many times the result.
"""

EPS = 2.0**-52


def rounding(operations: float, largest: float = 1.0) -> float:
    """Bound what so many operations lose, where no number on the way exceeds ``largest``."""
    return operations * largest * EPS
