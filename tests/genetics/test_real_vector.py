"""Real-valued genomes: bounds, crossover and mutation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from genetics import Keys, RealVector, Recipe, randomness, real_kernels
from genetics.real_kernels import BLEND, DECADES, WIDEST_STEP

finite = st.floats(-1e300, 1e300)


@st.composite
def vectors(draw):
    low, high = sorted(draw(st.lists(finite, min_size=2, max_size=2, unique=True)))
    return RealVector(draw(st.integers(1, 5)), low, high)


@st.composite
def keyed(draw, rows=3):
    cells = draw(st.lists(st.integers(0, (1 << 20) - 1), min_size=1, max_size=rows, unique=True))
    return Keys(np.array(cells), draw(st.integers(0, (1 << 64) - 1)), draw(st.integers(0, (1 << 31) - 1)))


def keys_of(rows=1, seed=1, generation=1):
    return Keys(np.arange(rows), seed, generation)


def couples_of(coding, keys, count):
    return coding.random(keys, 2 * count).reshape(len(keys.cells), count, 2, coding.genome_bytes)


def parents_of(couples):
    genes = couples.view(np.float64)
    return genes[:, :, 0], genes[:, :, 1]


def children_of(offspring):
    genes = offspring.view(np.float64)
    return genes[:, 0::2], genes[:, 1::2]


def bytes_of(*genes):
    return np.array(genes, dtype=np.float64).tobytes()


@given(vectors(), keyed(), st.integers(1, 4))
def test_random_demes_lie_within_the_bounds(coding, keys, deme):
    genomes = coding.random(keys, deme)
    assert genomes.shape == (len(keys.cells), deme, coding.genome_bytes)
    assert genomes.dtype == np.uint8
    genes = genomes.view(np.float64)
    assert ((genes >= coding.low) & (genes <= coding.high)).all()
    assert all(coding.alphabet.admits(genome) for genome in genomes.reshape(-1, coding.genome_bytes))


def test_random_genes_are_uniform_and_keyed_by_their_cell():
    coding = RealVector(3, -2.0, 6.0)
    keys = keys_of(rows=100)
    genomes = coding.random(keys, 100)
    counts, _ = np.histogram(genomes.view(np.float64), bins=50, range=(-2, 6))
    assert np.abs(counts - 600).max() < 5 * math.sqrt(600)
    alone = coding.random(Keys(np.array([42]), 1, 1), 100)
    np.testing.assert_array_equal(alone[0], genomes[42])
    assert (coding.random(keys_of(rows=100, seed=2), 100) != genomes).any()


@given(vectors(), keyed(), st.sampled_from(["blend", "uniform"]), st.floats(0, 1))
def test_offspring_lie_within_the_bounds(coding, keys, crossover, rate):
    offspring = coding.recombine(couples_of(coding, keys, 3), Recipe(crossover, rate), keys)
    assert offspring.shape == (len(keys.cells), 6, coding.genome_bytes)
    genes = offspring.view(np.float64)
    assert ((genes >= coding.low) & (genes <= coding.high)).all()
    assert all(coding.alphabet.admits(genome) for genome in offspring.reshape(-1, coding.genome_bytes))


def test_parents_on_the_bounds_have_offspring_on_and_between_them():
    coding = RealVector(4, -1.0, 1.0)
    keys = keys_of(rows=50)
    couples = np.empty((50, 4, 2, 4))
    couples[:, :, 0], couples[:, :, 1] = -1.0, 1.0
    genes = coding.recombine(couples.view(np.uint8), Recipe("blend", 0.5), keys).view(np.float64)
    assert genes.min() == -1.0
    assert genes.max() == 1.0
    # A quarter of blends fall beyond either bound and are put on it.
    assert np.mean(np.abs(genes) < 1) == pytest.approx(0.5, abs=0.1)


def test_uniform_offspring_share_out_the_genes_of_their_parents():
    coding = RealVector(5, 0.0, 1.0)
    keys = keys_of(rows=100)
    couples = couples_of(coding, keys, 10)
    firsts, seconds = parents_of(couples)
    ones, others = children_of(coding.recombine(couples, Recipe("uniform"), keys))
    kept = ones == firsts
    np.testing.assert_array_equal(ones, np.where(kept, firsts, seconds))
    np.testing.assert_array_equal(others, np.where(kept, seconds, firsts))
    assert np.abs(kept.mean(axis=(0, 1)) - 0.5).max() < 5 * 0.5 / math.sqrt(1000)


def test_blended_offspring_lie_as_far_beyond_their_parents_as_blx_lets_them():
    coding = RealVector(4, -1000.0, 1000.0)
    keys = keys_of(rows=100)
    couples = couples_of(coding, keys, 10)
    couples.view(np.float64)[...] /= 10  # so that no offspring meets a bound
    firsts, seconds = parents_of(couples)
    for children, own, other in zip(
        children_of(coding.recombine(couples, Recipe("blend"), keys)), (firsts, seconds), (seconds, firsts), strict=True
    ):
        share = (children - own) / (other - own)
        assert -BLEND <= share.min() < -BLEND + 0.01
        assert 1 + BLEND - 0.01 < share.max() <= 1 + BLEND + 1e-9
        assert share.mean() == pytest.approx(0.5, abs=0.05)
        assert share.var() == pytest.approx((1 + 2 * BLEND) ** 2 / 12, rel=0.1)


@pytest.mark.parametrize("crossover", ["blend", "uniform"])
def test_without_mutation_equal_parents_have_equal_offspring(crossover):
    coding = RealVector(4, -1.0, 1.0)
    keys = keys_of(rows=20)
    one = coding.random(keys, 1)[:, :, None, :]
    couples = np.ascontiguousarray(np.broadcast_to(one, (20, 3, 2, coding.genome_bytes)))
    offspring = coding.recombine(couples, Recipe(crossover, 0.0), keys)
    np.testing.assert_array_equal(offspring, np.broadcast_to(one[:, :, 0], offspring.shape))


@pytest.mark.parametrize("rate", [0.01, 0.3, 1.0])
def test_every_gene_changes_at_the_rate_by_steps_of_every_size(rate):
    coding = RealVector(6, -50.0, 50.0)
    keys = keys_of(rows=200)
    couples = np.zeros((200, 10, 2, 6)).view(np.uint8)
    steps = coding.recombine(couples, Recipe("blend", rate), keys).view(np.float64).reshape(-1, 6)
    changed = steps != 0.0
    deviation = 5 * math.sqrt(rate * (1 - rate) / len(steps))
    assert np.abs(changed.mean(axis=0) - rate).max() <= deviation
    sizes = np.abs(steps[changed])
    assert abs((steps[changed] > 0).mean() - 0.5) < 2.5 / math.sqrt(len(sizes))
    assert sizes.max() < 100 * WIDEST_STEP * 6
    if rate > 0.1:
        shares = [np.mean((sizes > low) & (sizes <= 10 * low)) for low in (0.01, 0.1, 1.0)]
        assert min(shares) > 0.15, "steps are spread over powers of ten"


def test_a_recipe_that_flips_bits_is_refused():
    coding = RealVector(2, 0.0, 1.0)
    couples = couples_of(coding, keys_of(), 1)
    with pytest.raises(ValueError, match="found 'one-bit'"):
        coding.check(Recipe("blend", "one-bit"))
    with pytest.raises(ValueError, match="no bits"):
        coding.mutate_one(couples[:, 0], keys_of())


@pytest.mark.parametrize("crossover", ["one-point", "two-point"])
def test_crossovers_of_other_codings_are_refused(crossover):
    with pytest.raises(ValueError, match=f"found '{crossover}'"):
        RealVector(2, 0.0, 1.0).check(Recipe(crossover))


@pytest.mark.parametrize(
    ("genome", "accepted"),
    [
        (bytes_of(0.0, 0.5), True),
        (bytes_of(-1.0, 2.0), True),
        (bytes_of(-0.0, 0.0), True),
        (bytes_of(math.nan, 0.5), False),
        (bytes_of(0.5, math.nan), False),
        (bytes_of(math.inf, 0.5), False),
        (bytes_of(-math.inf, 0.5), False),
        (bytes_of(math.nextafter(-1.0, -2.0), 0.5), False),
        (bytes_of(0.5, math.nextafter(2.0, 3.0)), False),
        (bytes_of(0.5), False),
        (bytes_of(0.5, 0.5, 0.5), False),
        (bytes_of(0.5, 0.5)[:-1], False),
        (b"", False),
    ],
)
def test_it_accepts_only_finite_genes_within_the_bounds(genome, accepted):
    assert RealVector(2, -1.0, 2.0).alphabet.admits(np.frombuffer(genome, np.uint8)) is accepted


def test_genes_are_the_coded_numbers():
    coding = RealVector(3, 0.0, 1.0)
    genomes = coding.random(keys_of(), 5)[0]
    assert coding.genome_bytes == 24
    assert coding.genes(genomes).shape == (5, 3)
    assert coding.genes(genomes).tobytes() == genomes.tobytes()
    np.testing.assert_array_equal(coding.genes(genomes[::2]), coding.genes(genomes)[::2])
    read_only = np.frombuffer(genomes.tobytes(), np.uint8).reshape(genomes.shape)
    np.testing.assert_array_equal(coding.genes(read_only), coding.genes(genomes))


@pytest.mark.parametrize(
    ("dimension", "low", "high"),
    [
        (0, 0.0, 1.0),
        (-1, 0.0, 1.0),
        (2, 1.0, 1.0),
        (2, 2.0, 1.0),
        (2, math.nan, 1.0),
        (2, 0.0, math.nan),
        (2, 0.0, math.inf),
        (2, -math.inf, 0.0),
        (2, -1e308, 1e308),  # infinitely far apart, as far as floats can tell
    ],
)
def test_impossible_vectors_are_refused(dimension, low, high):
    with pytest.raises(ValueError, match="found"):
        RealVector(dimension, low, high)


def everything(seed):
    coding = RealVector(3, -2.0, 5.0)
    keys = Keys(np.array([0, 5, 1023]), seed, 7)
    couples = couples_of(coding, keys, 2)
    recipes = [Recipe("blend"), Recipe("uniform"), Recipe("blend", 0.5), Recipe("uniform", 1.0)]
    return [couples, *(coding.recombine(couples, recipe, keys) for recipe in recipes)]


@pytest.mark.parametrize("seed", [1, 1992, (1 << 64) - 1])
def test_kernels_make_the_same_numbers_compiled_and_in_python(seed, monkeypatch):
    compiled_first, *compiled_offspring = everything(seed)
    for module in (randomness, real_kernels):
        for name, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)
    first, *offspring = everything(seed)
    np.testing.assert_array_equal(first, compiled_first)
    np.testing.assert_array_equal(offspring[:2], compiled_offspring[:2])
    for one, other in zip(offspring[2:], compiled_offspring[2:], strict=True):
        # Mutation takes logarithms, cosines and powers, which are those of two libraries.
        np.testing.assert_allclose(one.view(np.float64), other.view(np.float64), rtol=1e-12)


# Distributions ----------------------------------------------------------------------------------------------------
def deviations(counts, chances):
    """How far counts are from what is expected of ``chances``, in standard deviations of Pearson's statistic."""
    expected = np.sum(counts) * np.asarray(chances)
    return (np.sum((counts - expected) ** 2 / expected) - (len(counts) - 1)) / math.sqrt(2 * (len(counts) - 1))


def test_blend_shares_are_even_and_those_of_neighbours_unrelated():
    coding = RealVector(7, -10.0, 10.0)
    couples = np.zeros((500, 20, 2, 7))
    couples[:, :, 1] = 1.0
    offspring = coding.recombine(couples.view(np.uint8), Recipe("blend"), keys_of(rows=500)).view(np.float64)
    counts, _ = np.histogram(offspring, bins=200, range=(-BLEND, 1 + BLEND))
    assert counts.sum() == offspring.size
    assert abs(deviations(counts, np.full(200, 1 / 200))) < 5
    flat = offspring.reshape(500, -1)
    for apart in (1, 7, 14, 16, 64):  # genes, offspring, couples, draws made together, and words of these
        assert abs(np.corrcoef(flat[:, :-apart].ravel(), flat[:, apart:].ravel())[0, 1]) < 5 / math.sqrt(flat.size)


@pytest.mark.parametrize("rate", [0.002, 0.1, 0.9])
def test_changes_are_as_many_as_independent_ones_and_as_far_apart(rate):
    coding = RealVector(10, -1.0, 1.0)
    rows = 4000
    couples = np.zeros((rows, 5, 2, 10)).view(np.uint8)
    offspring = coding.recombine(couples, Recipe("blend", rate), keys_of(rows)).view(np.float64).reshape(rows, -1)
    changed = offspring != 0.0
    many = changed.sum(axis=1)  # binomial
    variance = 100 * rate * (1 - rate)
    assert abs(many.mean() - 100 * rate) < 5 * math.sqrt(variance / rows)
    assert many.var() == pytest.approx(variance, rel=5 * math.sqrt((2 + 1 / variance) / rows))
    both = changed[:, 1:] & changed[:, :-1]
    assert abs(both.mean() - rate**2) < 5 * math.sqrt(3 * rate**2 / both.size)


def test_a_tiny_rate_changes_hardly_anything():
    coding = RealVector(10, -1.0, 1.0)
    couples = np.zeros((1000, 5, 2, 10)).view(np.uint8)
    assert not coding.recombine(couples, Recipe("blend", 1e-12), keys_of(1000)).any()


def test_steps_are_normal_numbers_times_log_uniform_sizes():
    coding = RealVector(10, -50.0, 50.0)
    steps = coding.recombine(np.zeros((200, 20, 2, 10)).view(np.uint8), Recipe("blend", 1.0), keys_of(200))
    steps = steps.view(np.float64).ravel()
    rng = np.random.default_rng(5)
    sample = 100 * WIDEST_STEP * 10 ** (-DECADES * rng.random(4_000_000)) * rng.standard_normal(4_000_000)
    quantiles = np.quantile(np.clip(sample, -50, 50), np.arange(1, 40) / 40)
    counts = np.bincount(np.searchsorted(quantiles, steps), minlength=40)
    assert abs(deviations(counts, np.full(40, 1 / 40))) < 5


@given(vectors(), keyed(), st.sampled_from(["blend", "uniform"]), st.floats(0, 1), st.integers(1, 9))
def test_rows_recombined_together_are_those_recombined_alone(coding, keys, crossover, rate, count):
    couples, recipe = couples_of(coding, keys, count), Recipe(crossover, rate)
    together = coding.recombine(couples, recipe, keys)
    for row, cell in enumerate(keys.cells):
        alone = coding.recombine(couples[[row]], recipe, keys._replace(cells=np.array([cell])))
        np.testing.assert_array_equal(alone[0], together[row])
