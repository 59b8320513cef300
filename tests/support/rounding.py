"""The largest difference of two ways to compute a number that rounding alone can make."""

#: Largest relative error of a sum, a product, a quotient or a square root: half an ulp.
HALF_ULP = 2.0**-53
#: Largest error of a sine, an arc tangent or a similar function, half ulps. The kernels of numpy
#: for wide registers are within four ulps.
FUNCTION_ERROR = 8


def rounding_bound(operations: int, functions: int = 0) -> float:
    """The largest difference of two results of size 1.

    operations: sums, products, quotients and square roots on both ways together.
    functions: sines and similar functions on both ways together.
    """
    return (operations + FUNCTION_ERROR * functions) * HALF_ULP
