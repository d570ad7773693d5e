"""Passes over memory that do the work of several. Importing this module imports numba.

Threads share the rows of a kernel, and no row's result depends on who works on it. Arrays of numbers are
float32, or uint16 with the bits of bfloat16; arithmetic is float32 in either case. All kernels stand in one
module, because numba keeps machine code only while the file of its own function is the same, and all of them
call `widen` and `narrow`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import prange, types
from numba.extending import overload

from geoprior.compiled import compiled, inlined, shared

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Numbers = NDArray[np.float32] | NDArray[np.uint16]


BLOCK = 32
"""Rows and columns of a block: two of them stay in the first cache."""
PARTS = 64
"""Sums that a long sum is made of."""


def widen(x: Any) -> Any:
    """A number as float32."""


def narrow(x: Any, out: Any) -> Any:
    """A float32 as a number of the array: for bfloat16 the nearest, ties to even."""


@overload(widen, inline="always")  # type: ignore[untyped-decorator]
def _widen(x: Any) -> Any:
    def same(x: Any) -> Any:
        return x

    def shifted(x: Any) -> Any:
        return np.uint32(np.uint32(x) << np.uint32(16)).view(np.float32)

    return shifted if x == types.uint16 else same


@overload(narrow, inline="always")  # type: ignore[untyped-decorator]
def _narrow(x: Any, out: Any) -> Any:
    def same(x: Any, out: Any) -> Any:
        return x

    def rounded(x: Any, out: Any) -> Any:
        bits = np.float32(x).view(np.uint32)
        odd = (bits >> np.uint32(16)) & np.uint32(1)
        return np.uint16((bits + np.uint32(0x7FFF) + odd) >> np.uint32(16))

    return rounded if out.dtype == types.uint16 else same


@shared
def channel_moments(
    lanes: int, chunk: int, x: Numbers, origin: NDArray[np.float32], sums: NDArray[np.float32]
) -> None:
    """Sums of x - origin and of its square over each chunk of rows.

    Args:
        lanes: Threads to share the work.
        chunk: Rows in one.
        x: (rows, channels)
        origin: (channels,) near the mean, so that small variances are not lost.
        sums: (chunks, 2, channels) result.
    """
    for lane in prange(lanes):
        total, square = np.empty_like(origin), np.empty_like(origin)
        for number in range(len(sums) * lane // lanes, len(sums) * (lane + 1) // lanes):
            total[:] = square[:] = np.float32(0.0)
            for row in range(number * chunk, min((number + 1) * chunk, x.shape[0])):
                values = x[row]
                for c in range(values.size):
                    away = widen(values[c]) - origin[c]
                    total[c] += away
                    square[c] += away * away
            sums[number, 0], sums[number, 1] = total, square


@shared
def affine_relu(
    lanes: int,
    x: Numbers,
    residual: Numbers,
    scale: NDArray[np.float32],
    shift: NDArray[np.float32],
    y: Numbers,
) -> None:
    """The ReLU of x * scale + shift + residual, by channel.

    Args:
        lanes: Threads to share the work.
        x: (rows, channels)
        residual: The same, or no rows.
        scale: (channels,)
        shift: (channels,)
        y: (rows, channels) result.
    """
    zero = np.float32(0.0)
    for lane in prange(lanes):
        for row in range(len(x) * lane // lanes, len(x) * (lane + 1) // lanes):
            values, out = x[row], y[row]
            if residual.shape[0] == 0:
                for c in range(out.size):
                    value = widen(values[c]) * scale[c] + shift[c]
                    out[c] = narrow(zero if value <= zero else value, out)
            else:
                others = residual[row]
                for c in range(out.size):
                    value = widen(values[c]) * scale[c] + shift[c] + widen(others[c])
                    out[c] = narrow(zero if value <= zero else value, out)


@shared
def relu_sums(
    lanes: int,
    chunk: int,
    gradient: Numbers,
    y: Numbers,
    x: Numbers,
    mean: NDArray[np.float32],
    sums: NDArray[np.float32],
) -> None:
    """Sums of a ReLU's gradient, and of its product with x - mean, over each chunk of rows.

    Args:
        lanes: Threads to share the work.
        chunk: Rows in one.
        gradient: (rows, channels) of y.
        y: (rows, channels) what the ReLU gave.
        x: (rows, channels) before the norm.
        mean: (channels,)
        sums: (chunks, 2, channels) result.
    """
    zero = np.float32(0.0)
    for lane in prange(lanes):
        total, product = np.empty_like(mean), np.empty_like(mean)
        for number in range(len(sums) * lane // lanes, len(sums) * (lane + 1) // lanes):
            total[:] = product[:] = zero
            for row in range(number * chunk, min((number + 1) * chunk, x.shape[0])):
                slopes, given, values = gradient[row], y[row], x[row]
                for c in range(values.size):
                    slope = widen(slopes[c])
                    slope = slope if widen(given[c]) > zero else zero
                    total[c] += slope
                    product[c] += slope * (widen(values[c]) - mean[c])
            sums[number, 0], sums[number, 1] = total, product


@shared
def relu_affine_back(
    lanes: int,
    gradient: Numbers,
    y: Numbers,
    x: Numbers,
    coefficients: NDArray[np.float32],
    of_x: Numbers,
    of_residual: Numbers,
) -> None:
    """Of a ReLU's gradient g: ``of_x = a * g + b * x + c`` by channel, and ``of_residual = g``.

    Args:
        lanes: Threads to share the work.
        gradient: (rows, channels) of y.
        y: (rows, channels) what the ReLU gave.
        x: (rows, channels) before the norm, or no rows: then b and c count as 0.
        coefficients: (3, channels) a, b and c.
        of_x: (rows, channels) result.
        of_residual: The same, or no rows.
    """
    zero = np.float32(0.0)
    a, b, c0 = coefficients[0], coefficients[1], coefficients[2]
    for lane in prange(lanes):
        masked = np.empty(gradient.shape[1], np.float32)
        for row in range(len(gradient) * lane // lanes, len(gradient) * (lane + 1) // lanes):
            slopes, given, out = gradient[row], y[row], of_x[row]
            for c in range(masked.size):
                slope = widen(slopes[c])
                masked[c] = slope if widen(given[c]) > zero else zero
            if of_residual.shape[0] > 0:
                other = of_residual[row]
                for c in range(masked.size):
                    other[c] = narrow(masked[c], other)
            if x.shape[0] == 0:
                for c in range(masked.size):
                    out[c] = narrow(masked[c] * a[c], out)
            else:
                values = x[row]
                for c in range(masked.size):
                    out[c] = narrow(masked[c] * a[c] + widen(values[c]) * b[c] + c0[c], out)


@shared
def affine_relu_pool(
    lanes: int,
    x: Numbers,
    scale: NDArray[np.float32],
    shift: NDArray[np.float32],
    y: Numbers,
    place: NDArray[np.uint8],
    chosen: Numbers,
) -> None:
    """The largest ReLU of x * scale + shift in every 3x3 cells, in steps of two, with a margin of one.

    Args:
        lanes: Threads to share the work.
        x: (images, H, W, channels)
        scale: (channels,)
        shift: (channels,)
        y: (images, h, w, channels) result.
        place: The same shape: which of the nine cells it was, or 9 where no number is above zero.
        chosen: The number of x there, or any of them; or no images.
    """
    height, width, channels = x.shape[1:]
    zero, lowest = np.float32(0.0), np.float32(-np.inf)
    numbers = x.reshape(x.size)
    steps = np.zeros(10, np.int64)
    for cell in range(9):
        steps[cell] = ((cell // 3 - 1) * width + cell % 3 - 1) * channels
    for lane in prange(lanes):
        best, where = np.empty(channels, np.float32), np.empty(channels, np.int32)
        moved = np.empty((3, width + 2, channels), np.float32)
        for image in range(len(x) * lane // lanes, len(x) * (lane + 1) // lanes):
            for i in range(y.shape[1]):
                moved[:] = lowest
                for k in range(max(0, 1 - 2 * i), min(3, height + 1 - 2 * i)):
                    for column in range(width):
                        values, out = x[image, 2 * i - 1 + k, column], moved[k, column + 1]
                        for c in range(channels):
                            out[c] = widen(values[c]) * scale[c] + shift[c]
                for j in range(y.shape[2]):
                    best[:] = zero
                    where[:] = 9
                    for k in range(3):
                        # Of more arrays than these the compiler could not tell that they are apart.
                        one, two, three = moved[k, 2 * j], moved[k, 2 * j + 1], moved[k, 2 * j + 2]
                        for c in range(channels):
                            top, cell = best[c], where[c]
                            better = one[c] > top or one[c] != one[c]
                            top, cell = one[c] if better else top, 3 * k if better else cell
                            better = two[c] > top or two[c] != two[c]
                            top, cell = two[c] if better else top, 3 * k + 1 if better else cell
                            better = three[c] > top or three[c] != three[c]
                            top, cell = three[c] if better else top, 3 * k + 2 if better else cell
                            best[c], where[c] = top, cell
                    pooled, cells = y[image, i, j], place[image, i, j]
                    for c in range(channels):
                        pooled[c] = narrow(best[c], pooled)
                    for c in range(channels):
                        cells[c] = where[c]
                    if chosen.shape[0] > 0:
                        kept = chosen[image, i, j]
                        middle = ((image * height + 2 * i) * width + 2 * j) * channels
                        for c in range(channels):
                            kept[c] = numbers[middle + c + steps[where[c]]]


@shared
def pool_affine_back(
    lanes: int,
    gradient: Numbers,
    place: NDArray[np.uint8],
    x: Numbers,
    coefficients: NDArray[np.float32],
    of_x: Numbers,
) -> None:
    """Of what the pooling of `affine_relu_pool` passes back, g: ``of_x = a * g + b * x + c`` by channel.

    Args:
        lanes: Threads to share the work.
        gradient: (images, h, w, channels)
        place: As it gave it.
        x: (images, H, W, channels), or no images: then b and c count as 0.
        coefficients: (3, channels) a, b and c.
        of_x: (images, H, W, channels) result.
    """
    height, width, channels = of_x.shape[1:]
    rows, columns = gradient.shape[1:3]
    zero = np.float32(0.0)
    a, b, c0 = coefficients[0], coefficients[1], coefficients[2]
    for lane in prange(lanes):
        total = np.empty(channels, np.float32)
        for image in range(len(of_x) * lane // lanes, len(of_x) * (lane + 1) // lanes):
            for i in range(height):
                for j in range(width):
                    total[:] = zero
                    for row in range(i // 2, min((i + 1) // 2 + 1, rows)):
                        for column in range(j // 2, min((j + 1) // 2 + 1, columns)):
                            cell = 3 * (i - 2 * row + 1) + j - 2 * column + 1
                            slopes, cells = gradient[image, row, column], place[image, row, column]
                            for c in range(channels):
                                slope = widen(slopes[c])
                                total[c] += slope if cells[c] == cell else zero
                    out = of_x[image, i, j]
                    if x.shape[0] == 0:
                        for c in range(channels):
                            out[c] = narrow(total[c] * a[c], out)
                    else:
                        values = x[image, i, j]
                        for c in range(channels):
                            out[c] = narrow(total[c] * a[c] + widen(values[c]) * b[c] + c0[c], out)


@compiled
def draw_bytes(seed: int, word: int, words: NDArray[np.uint64]) -> None:
    """Random bits by their place: of splitmix64 (Steele et al. 2014) the numbers from ``word`` on."""
    golden, one = np.uint64(0x9E3779B97F4A7C15), np.uint64(1)
    begun = np.uint64(seed) + np.uint64(word) * golden
    for i in range(words.size):
        z = begun + (np.uint64(i) + one) * golden
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        words[i] = z ^ (z >> np.uint64(31))


@compiled
def draw_mask(
    seed: int, dropped: int, row: int, words: NDArray[np.uint64], mask: NDArray[np.float32]
) -> None:
    """What dropout multiplies a row with: 0 in ``dropped`` of 256 cases, else what makes up for it.

    Args:
        seed: Of 63 bits.
        dropped: Of 256; below 256.
        row: Its number; every row has words of its own.
        words: Room for a byte a number.
        mask: Flat result.
    """
    kept = np.float32(256.0) / np.float32(256 - dropped)
    if dropped == 0:
        mask[:] = kept
        return
    draw_bytes(seed, row * words.size, words)
    levels = words.view(np.uint8)
    for i in range(mask.size):
        mask[i] = np.float32(0.0) if levels[i] < dropped else kept


@compiled
def exponentiate(x: NDArray[np.float32]) -> None:
    """Replace numbers that are not above zero by their exponentials, to two units in the last place.

    Cephes' reduction and polynomial (Moshier 1989): numba's own exponential takes numbers one by one. What
    would be below the smallest normal number becomes zero.
    """
    lowest, one, half = np.float32(-87.0), np.float32(1.0), np.float32(0.5)
    for i in range(x.size):
        value = x[i] if x[i] > lowest or x[i] != x[i] else lowest
        power = np.floor(value * np.float32(1.44269504) + half)
        rest = value - power * np.float32(0.693359375) + power * np.float32(2.12194440e-4)
        series = np.float32(1.9875691500e-4) * rest + np.float32(1.3981999507e-3)
        series = series * rest + np.float32(8.3334519073e-3)
        series = series * rest + np.float32(4.1665795894e-2)
        series = series * rest + np.float32(1.6666665459e-1)
        series = series * rest + np.float32(5.0000001201e-1)
        scale = np.int32((np.int32(power) + np.int32(127)) << np.int32(23)).view(np.float32)
        result = (series * rest * rest + rest + one) * scale
        x[i] = np.float32(0.0) if x[i] <= lowest else result


@inlined
def add_up(x: NDArray[np.float32], parts: NDArray[np.float32]) -> Any:
    """The sum as float32, in an order that is written down here: vector units can take it as it stands.

    Args:
        x: Flat.
        parts: Room for `PARTS` numbers.
    """
    total = np.float32(0.0)
    if x.size < PARTS:
        for i in range(x.size):
            total += x[i]
        return total
    whole = x.size // PARTS * PARTS
    parts[:] = total
    for first in range(0, whole, PARTS):
        some = x[first : first + PARTS]
        for j in range(PARTS):
            parts[j] += some[j]
    for i in range(whole, x.size):
        parts[i - whole] += x[i]
    left = PARTS // 2
    while left > 0:
        for j in range(left):
            parts[j] += parts[left + j]
        left //= 2
    return parts[0]


@shared
def drop_add_norm(
    lanes: int,
    x: Numbers,
    branch: Numbers,
    weight: NDArray[np.float32],
    shift: NDArray[np.float32],
    bias: NDArray[np.float32],
    epsilon: float,
    seed: int,
    dropped: int,
    added: Numbers,
    y: Numbers,
    moments: NDArray[np.float32],
) -> None:
    """Layer norm of x + dropout(branch + bias).

    Args:
        lanes: Threads to share the work.
        x: (rows, n)
        branch: (rows, n)
        weight: (n,) of the norm.
        shift: (n,) the norm's bias.
        bias: (n,) of the branch.
        epsilon: Added to the variance.
        seed: Of the dropout.
        dropped: Of 256.
        added: (rows, n) result before the norm.
        y: (rows, n) result.
        moments: (rows, 2) mean and reciprocal deviation.
    """
    n = x.shape[1]
    share = np.float32(1.0) / np.float32(n)
    for lane in prange(lanes):
        words, mask = np.empty((n + 7) // 8, np.uint64), np.empty(n, np.float32)
        values, squares = np.empty(n, np.float32), np.empty(n, np.float32)
        parts = np.empty(PARTS, np.float32)
        for row in range(len(x) * lane // lanes, len(x) * (lane + 1) // lanes):
            draw_mask(seed, dropped, row, words, mask)
            one, other, between, out = x[row], branch[row], added[row], y[row]
            for i in range(n):
                between[i] = narrow(widen(one[i]) + (widen(other[i]) + bias[i]) * mask[i], between)
            for i in range(n):
                values[i] = widen(between[i])
            mean = add_up(values, parts) * share
            for i in range(n):
                values[i] -= mean
                squares[i] = values[i] * values[i]
            variance = add_up(squares, parts) * share
            scale = np.float32(1.0) / np.sqrt(variance + np.float32(epsilon))
            for i in range(n):
                out[i] = narrow(values[i] * scale * weight[i] + shift[i], out)
            moments[row, 0], moments[row, 1] = mean, scale


@shared
def drop_add_norm_back(
    lanes: int,
    chunk: int,
    gradient: Numbers,
    added: Numbers,
    weight: NDArray[np.float32],
    moments: NDArray[np.float32],
    seed: int,
    dropped: int,
    of_x: Numbers,
    of_branch: Numbers,
    totals: NDArray[np.float32],
) -> None:
    """The gradients of `drop_add_norm`.

    Args:
        lanes: Threads to share the work.
        chunk: Rows in one.
        gradient: (rows, n)
        added: As it gave it.
        weight: (n,)
        moments: As it gave them.
        seed: As it was.
        dropped: As it was.
        of_x: (rows, n) result.
        of_branch: The same; no rows where nothing is dropped, since it is that of x.
        totals: (chunks, 3, n) result: what each chunk adds to the gradients of the norm's weight and bias and
            of the branch's bias.
    """
    rows, n = gradient.shape
    share = np.float32(1.0) / np.float32(n)
    for lane in prange(lanes):
        words, mask = np.empty((n + 7) // 8, np.uint64), np.empty(n, np.float32)
        unit, slope = np.empty(n, np.float32), np.empty(n, np.float32)
        of_weight, of_bias = np.empty(n, np.float32), np.empty(n, np.float32)
        of_moved, product = np.empty(n, np.float32), np.empty(n, np.float32)
        parts = np.empty(PARTS, np.float32)
        for number in range(len(totals) * lane // lanes, len(totals) * (lane + 1) // lanes):
            of_weight[:] = of_bias[:] = of_moved[:] = np.float32(0.0)
            for row in range(number * chunk, min((number + 1) * chunk, rows)):
                slopes, between, out = gradient[row], added[row], of_x[row]
                mean, scale = moments[row, 0], moments[row, 1]
                for i in range(n):
                    unit[i] = (widen(between[i]) - mean) * scale
                    given = widen(slopes[i])
                    slope[i] = given * weight[i]
                    of_weight[i] += given * unit[i]
                    of_bias[i] += given
                for i in range(n):
                    product[i] = slope[i] * unit[i]
                total, along = add_up(slope, parts) * share, add_up(product, parts) * share
                for i in range(n):
                    slope[i] = scale * (slope[i] - total - unit[i] * along)
                    out[i] = narrow(slope[i], out)
                if of_branch.shape[0] > 0:
                    draw_mask(seed, dropped, row, words, mask)
                    other = of_branch[row]
                    for i in range(n):
                        slope[i] *= mask[i]
                        other[i] = narrow(slope[i], other)
                for i in range(n):
                    of_moved[i] += slope[i]
            totals[number, 0], totals[number, 1], totals[number, 2] = of_weight, of_bias, of_moved


@shared
def relu_drop(lanes: int, x: Numbers, bias: NDArray[np.float32], seed: int, dropped: int, y: Numbers) -> None:
    """Dropout of the ReLU of x + bias.

    Args:
        lanes: Threads to share the work.
        x: (rows, n)
        bias: (n,)
        seed: Of 63 bits.
        dropped: Of 256.
        y: (rows, n) result.
    """
    n = x.shape[1]
    zero = np.float32(0.0)
    for lane in prange(lanes):
        words, mask = np.empty((n + 7) // 8, np.uint64), np.empty(n, np.float32)
        for row in range(len(x) * lane // lanes, len(x) * (lane + 1) // lanes):
            draw_mask(seed, dropped, row, words, mask)
            values, out = x[row], y[row]
            for i in range(n):
                value = widen(values[i]) + bias[i]
                out[i] = narrow(mask[i] * (zero if value <= zero else value), out)


@shared
def relu_drop_back(
    lanes: int,
    chunk: int,
    gradient: Numbers,
    y: Numbers,
    kept: float,
    of_x: Numbers,
    totals: NDArray[np.float32],
) -> None:
    """The gradient of `relu_drop`: what is above zero was neither cut off nor dropped.

    Args:
        lanes: Threads to share the work.
        chunk: Rows in one.
        gradient: (rows, n)
        y: As it gave it.
        kept: What it multiplied with.
        of_x: (rows, n) result.
        totals: (chunks, n) result: what each chunk adds to the gradient of the bias.
    """
    zero, factor = np.float32(0.0), np.float32(kept)
    rows, n = gradient.shape
    for lane in prange(lanes):
        slope, total = np.empty(n, np.float32), np.empty(n, np.float32)
        for number in range(len(totals) * lane // lanes, len(totals) * (lane + 1) // lanes):
            total[:] = zero
            for row in range(number * chunk, min((number + 1) * chunk, rows)):
                slopes, given, out = gradient[row], y[row], of_x[row]
                for i in range(n):
                    passed = factor * widen(slopes[i])
                    slope[i] = passed if widen(given[i]) > zero else zero
                    total[i] += slope[i]
                for i in range(n):
                    out[i] = narrow(slope[i], out)
            totals[number] = total


@shared
def softmax_drop(
    lanes: int,
    scores: Numbers,
    valid: NDArray[np.bool_],
    scale: float,
    seed: int,
    dropped: int,
    weights: Numbers,
    kept: Numbers,
) -> None:
    """Softmax of scaled scores, and dropout of it.

    Args:
        lanes: Threads to share the work.
        scores: (slabs, queries, keys); a slab is a head of a sample.
        valid: (samples, keys) which keys may be looked at; or no samples.
        scale: Of the scores.
        seed: Of 63 bits.
        dropped: Of 256.
        weights: The shape of the scores, result before dropout.
        kept: The same after it.
    """
    slabs, queries, keys = scores.shape
    size = queries * keys
    given, out, left = scores.reshape(slabs, size), weights.reshape(slabs, size), kept.reshape(slabs, size)
    factor, nowhere = np.float32(scale), np.float32(-np.inf)
    heads = slabs // max(valid.shape[0], 1)
    for lane in prange(lanes):
        words, mask = np.empty((size + 7) // 8, np.uint64), np.empty(size, np.float32)
        values, parts = np.empty(size, np.float32), np.empty(PARTS, np.float32)
        for slab in range(slabs * lane // lanes, slabs * (lane + 1) // lanes):
            for i in range(size):
                values[i] = widen(given[slab, i]) * factor
            for query in range(queries):
                row = values[query * keys : (query + 1) * keys]
                if valid.shape[0] > 0:
                    for key in range(keys):
                        row[key] = row[key] if valid[slab // heads, key] else nowhere
                largest = nowhere
                for key in range(keys):
                    largest = max(largest, row[key])
                for key in range(keys):
                    row[key] -= largest
            exponentiate(values)
            for query in range(queries):
                row = values[query * keys : (query + 1) * keys]
                share = np.float32(1.0) / add_up(row, parts)
                for key in range(keys):
                    row[key] *= share
            draw_mask(seed, dropped, slab, words, mask)
            for i in range(size):
                out[slab, i] = narrow(values[i], out)
            for i in range(size):
                left[slab, i] = narrow(values[i] * mask[i], left)


@shared
def softmax_drop_back(
    lanes: int,
    gradient: Numbers,
    weights: Numbers,
    scale: float,
    seed: int,
    dropped: int,
    of_scores: Numbers,
) -> None:
    """The gradient of `softmax_drop`.

    Args:
        lanes: Threads to share the work.
        gradient: (slabs, queries, keys)
        weights: As it gave them.
        scale: As it was.
        seed: As it was.
        dropped: As it was.
        of_scores: (slabs, queries, keys) result.
    """
    slabs, queries, keys = gradient.shape
    size = queries * keys
    slopes, given = gradient.reshape(slabs, size), weights.reshape(slabs, size)
    out = of_scores.reshape(slabs, size)
    factor = np.float32(scale)
    for lane in prange(lanes):
        words, mask = np.empty((size + 7) // 8, np.uint64), np.empty(size, np.float32)
        share, product = np.empty(size, np.float32), np.empty(keys, np.float32)
        parts = np.empty(PARTS, np.float32)
        for slab in range(slabs * lane // lanes, slabs * (lane + 1) // lanes):
            draw_mask(seed, dropped, slab, words, mask)
            for i in range(size):
                mask[i] *= widen(slopes[slab, i])
                share[i] = widen(given[slab, i])
            for query in range(queries):
                row, of_row = (
                    share[query * keys : (query + 1) * keys],
                    mask[query * keys : (query + 1) * keys],
                )
                for key in range(keys):
                    product[key] = of_row[key] * row[key]
                total = add_up(product, parts)
                for key in range(keys):
                    of_row[key] -= total
            for i in range(size):
                out[slab, i] = narrow(factor * share[i] * mask[i], out)


@shared
def split_heads(
    lanes: int, projected: Numbers, bias: NDArray[np.float32], moved: int, split: Numbers
) -> None:
    """Lay projections out by heads, with biases added and, to the first ones, what positions add.

    Args:
        lanes: Threads to share the work.
        projected: (samples + 1, tokens, parts, heads, n): samples, and behind them what the positions add.
        bias: (parts, heads, n)
        moved: Parts that have positions.
        split: (parts, samples, heads, tokens, n) result.
    """
    _, tokens, parts, heads, n = projected.shape
    samples = len(projected) - 1
    one, zero = np.float32(1.0), np.float32(0.0)
    for lane in prange(lanes):
        for sample in range(samples * lane // lanes, samples * (lane + 1) // lanes):
            for part in range(parts):
                share = one if part < moved else zero
                for token in range(tokens):
                    for head in range(heads):
                        given = projected[sample, token, part, head]
                        position = projected[samples, token, part, head]
                        added, out = bias[part, head], split[part, sample, head, token]
                        for i in range(n):
                            out[i] = narrow(widen(given[i]) + share * widen(position[i]) + added[i], out)


@shared
def join_heads(
    lanes: int, chunk: int, gradients: Numbers, joined: Numbers, totals: NDArray[np.float32]
) -> None:
    """The gradients of `split_heads`, but that of what the positions add.

    Args:
        lanes: Threads to share the work.
        chunk: Samples in one.
        gradients: (parts, samples, heads, tokens, n)
        joined: (samples + 1, tokens, parts, heads, n); gets all but the last.
        totals: (chunks, tokens, parts, heads, n) result: the sum over each chunk of samples.
    """
    _, tokens, parts, heads, n = joined.shape
    samples = len(joined) - 1
    for lane in prange(lanes):
        for number in range(len(totals) * lane // lanes, len(totals) * (lane + 1) // lanes):
            totals[number] = np.float32(0.0)
            for sample in range(number * chunk, min((number + 1) * chunk, samples)):
                for part in range(parts):
                    for head in range(heads):
                        for token in range(tokens):
                            given, out = (
                                gradients[part, sample, head, token],
                                joined[sample, token, part, head],
                            )
                            total = totals[number, token, part, head]
                            for i in range(n):
                                out[i] = given[i]
                            for i in range(n):
                                total[i] += widen(given[i])


@shared
def transpose(lanes: int, x: Numbers, y: Numbers) -> None:
    """Lay a matrix out anew, block by block.

    Args:
        lanes: Threads to share the work.
        x: (rows, columns)
        y: (columns, rows) result.
    """
    rows, columns = x.shape
    blocks = -(-columns // BLOCK)
    for lane in prange(lanes):
        for block in range(blocks * lane // lanes, blocks * (lane + 1) // lanes):
            left, right = block * BLOCK, min((block + 1) * BLOCK, columns)
            for top in range(0, rows, BLOCK):
                bottom = min(top + BLOCK, rows)
                for column in range(left, right):
                    out = y[column]
                    for row in range(top, bottom):
                        out[row] = x[row, column]


@shared
def unshuffle(lanes: int, x: Numbers, cells: Numbers, margin: int) -> None:
    """Take every 2x2 pixels as one cell, whose channels are theirs, row by row; zero outside the frame.

    Args:
        lanes: Threads to share the work.
        x: (images, H, W, channels)
        cells: (images, h, w, 4 * channels) result.
        margin: Pixels before the frame's first row and column in the first cell and those after it.
    """
    images, height, width, channels = x.shape
    pair = 2 * channels
    rows = x.reshape(images, height, width * channels)
    for lane in prange(lanes):
        for image in range(images * lane // lanes, images * (lane + 1) // lanes):
            for i in range(cells.shape[1]):
                for dy in range(2):
                    row = 2 * i + dy - margin
                    for j in range(cells.shape[2]):
                        out = cells[image, i, j, dy * pair : (dy + 1) * pair]
                        first = (2 * j - margin) * channels
                        for t in range(pair):
                            inside = 0 <= row < height and 0 <= first + t < rows.shape[2]
                            out[t] = narrow(widen(rows[image, row, first + t]), out) if inside else 0


@shared
def gather_cells(lanes: int, x: Numbers, kernel: int, stride: int, seen: Numbers) -> None:
    """For each cell of a convolution's result what its kernel sees; zero outside the map.

    Args:
        lanes: Threads to share the work.
        x: (images, H, W, channels)
        kernel: Odd; the margin is half of it.
        stride: Of the kernel's steps.
        seen: (images, h, w, kernel, kernel, channels) result.
    """
    _, height, width, channels = x.shape
    _, rows, columns = seen.shape[:3]
    margin = kernel // 2
    for lane in prange(lanes):
        for image in range(len(x) * lane // lanes, len(x) * (lane + 1) // lanes):
            for i in range(rows):
                for j in range(columns):
                    for a in range(kernel):
                        for b in range(kernel):
                            row, column = stride * i + a - margin, stride * j + b - margin
                            out = seen[image, i, j, a, b]
                            if 0 <= row < height and 0 <= column < width:
                                given = x[image, row, column]
                                for c in range(channels):
                                    out[c] = given[c]
                            else:
                                for c in range(channels):
                                    out[c] = 0


@shared
def scatter_cells(lanes: int, of_seen: Numbers, kernel: int, stride: int, of_x: Numbers) -> None:
    """The gradient of `gather_cells`.

    Args:
        lanes: Threads to share the work.
        of_seen: (images, h, w, kernel, kernel, channels)
        kernel: As it was.
        stride: As it was.
        of_x: (images, H, W, channels) result.
    """
    _, height, width, channels = of_x.shape
    _, rows, columns = of_seen.shape[:3]
    margin = kernel // 2
    for lane in prange(lanes):
        total = np.empty(channels, np.float32)
        for image in range(len(of_x) * lane // lanes, len(of_x) * (lane + 1) // lanes):
            for row in range(height):
                for column in range(width):
                    total[:] = np.float32(0.0)
                    for a in range(kernel):
                        i, odd = divmod(row + margin - a, stride)
                        if odd or not 0 <= i < rows:
                            continue
                        for b in range(kernel):
                            j, odd = divmod(column + margin - b, stride)
                            if odd or not 0 <= j < columns:
                                continue
                            given = of_seen[image, i, j, a, b]
                            for c in range(channels):
                                total[c] += widen(given[c])
                    out = of_x[image, row, column]
                    for c in range(channels):
                        out[c] = narrow(total[c], out)
