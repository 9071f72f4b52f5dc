"""The functions of numbers as the literature writes them, in plain numpy; `evaluate` uses none of this."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


def value(name: str, x: Points) -> float:
    """Return the values of the function of numbers ``name`` at points of shape (..., dimension)."""
    values: dict[str, Any] = {
        "sphere": lambda: np.sum(x**2, axis=-1),
        "rastrigin": lambda: 10 * x.shape[-1] + np.sum(x**2 - 10 * np.cos(2 * np.pi * x), axis=-1),
        "ackley": lambda: (
            -20 * np.exp(-0.2 * np.sqrt(np.mean(x**2, axis=-1)))
            - np.exp(np.mean(np.cos(2 * np.pi * x), axis=-1))
            + 20
            + np.e
        ),
        "rosenbrock": lambda: np.sum(100 * (x[..., 1:] - x[..., :-1] ** 2) ** 2 + (1 - x[..., :-1]) ** 2, axis=-1),
    }
    return values[name]()  # type: ignore[no-any-return]
