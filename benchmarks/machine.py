"""Measure the limits of the machine: copies, reads of memory at random, multiplications and additions."""

from __future__ import annotations

import numba as nb
import numpy as np

import report

NUMBERS = 42_000_000  # of eight bytes: 336 MB, the coordinates of 14 million points
LINE = 8  # numbers in 64 bytes
LINES = 4_000_000  # number of reads
DEGREE = 16
VALUES = 1024  # fit in the first cache
SWEEPS = 20_000


@nb.njit(cache=True, parallel=True)
def _copy(given, made):
    for i in nb.prange(len(given)):
        made[i] = given[i]


@nb.njit(cache=True, parallel=True)
def _fetch(given, lines):
    total = 0.0
    for i in nb.prange(len(lines)):
        total += given[lines[i] * LINE]
    return total


@nb.njit(cache=True, parallel=True, fastmath=True)
def _polynomials(values, sweeps, made):
    """Evaluate two polynomials at each value, by Horner's scheme, many times.

    Two polynomials and several values at a time keep the arithmetic units busy: none has to wait for a result.
    """
    for thread in nb.prange(len(made)):
        for sweep in range(sweeps):
            factor = 1.0 / (sweep + 2)
            for i in range(len(values)):
                x = factor * values[i]
                y = z = x
                for _ in range(DEGREE):
                    y = y * x + 0.5
                    z = z * x + 0.25
                made[thread, i] += y + z


def copying(threads: int) -> float:
    """Return the GB/s that a copy of memory reads and writes."""
    given, made = np.ones(NUMBERS), np.empty(NUMBERS)
    return 2 * given.nbytes / report.least_time(lambda: _copy(given, made)) / 1e9


def fetching(threads: int) -> float:
    """Return the ns of a read of a line of memory at a random place."""
    given = np.ones(NUMBERS)
    lines = np.random.default_rng(0).integers(0, NUMBERS // LINE, LINES)
    return report.least_time(lambda: _fetch(given, lines)) / LINES * 1e9


def multiplying(threads: int) -> float:
    """Return the GFLOP/s of multiplications and additions of doubles that are in the cache."""
    values, sums = np.linspace(0, 0.5, VALUES), np.zeros((threads, VALUES))
    return 4 * DEGREE * SWEEPS * sums.size / report.least_time(lambda: _polynomials(values, SWEEPS, sums)) / 1e9


WORKS = {
    "copy of 336 MB, GB/s read and written": copying,
    "lines of 64 bytes at random out of 336 MB, ns each": fetching,
    "multiply and add as two operations, GFLOP/s": multiplying,
}


def limits() -> report.Section:
    """Return the table of the limits, with one thread and with all."""
    most = nb.get_num_threads()
    rows = {name: [] for name in WORKS}
    for threads in range(1, most + 1):
        nb.set_num_threads(threads)
        for name, work in WORKS.items():
            rows[name].append(f"{work(threads):.1f}")
    return report.Section(
        "Limits of the machine",
        ("what", "1 thread", *(f"{threads} threads" for threads in range(2, most + 1))),
        [(name, *values) for name, values in rows.items()],
    )
