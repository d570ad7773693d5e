"""Machine code: the same bits whether it was compiled just now or comes from the disk."""

from geoprior import compiled

NORM = """
import hashlib
import numpy as np
from geoprior.policies.fused._kernels import drop_add_norm_back as kernel

rng = np.random.default_rng(0)
digest = hashlib.sha256()
for rows, n in ((16, 16), (40, 100), (70, 512)):
    gradient, added, moments, weight = (
        rng.normal(size=size).astype(np.float32) for size in ((rows, n), (rows, n), (rows, 2), n)
    )
    results = [np.empty_like(added), np.empty_like(added), np.empty((1, 3, n), np.float32)]
    kernel(1, rows, gradient, added, weight, moments, 5, 26, *results)
    for result in results:
        digest.update(result.tobytes())
print(digest.hexdigest(), sum(kernel.stats.cache_hits.values()))
"""


def test_what_is_compiled_and_what_is_read_from_the_disk_agree_to_the_bit(run_python, tmp_path):
    folder = {"NUMBA_CACHE_DIR": str(tmp_path)}
    fresh, known = run_python(NORM, **folder).split(), run_python(NORM, **folder).split()
    assert (fresh[1], known[1]) == ("0", "1"), "one of them compiled, the other did not"
    assert fresh[0] == known[0]


def test_nothing_is_compiled_so_that_sums_may_be_reordered():
    for decorator in (compiled.compiled, compiled.inlined, compiled.shared):
        assert not decorator(lambda x: x + 1.0).targetoptions.get("fastmath", False)


def test_it_compiles_where_no_cache_folder_can_be_written(monkeypatch):
    def njit(cache=False, **options):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return lambda function: (function, options)

    monkeypatch.setattr(compiled.numba, "njit", njit)
    function, options = compiled.compiled(len)
    assert function is len
    assert "fastmath" not in options
