"""Floors of mobile robots, as tests draw them."""

from hypothesis import strategies as st


def things(from_x, to_x, most):
    """A strategy of obstacles, circles and boxes at any angle, in a strip of a floor 6 m deep."""
    places = st.tuples(st.floats(from_x, to_x), st.floats(0.0, 6.0), st.floats(0.1, 0.6), st.booleans())
    return st.lists(places.map(_obstacle), max_size=most)


def _obstacle(thing):
    x, y, size, is_round = thing
    if is_round:
        return {"shape": "circle", "center": [x, y], "radius": size}
    return {"shape": "box", "center": [x, y], "size": [size, 2 * size], "angle": x}
