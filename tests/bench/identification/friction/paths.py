"""Motions and equations made up for the tests of friction."""

import numpy as np

from norton_bench.identification.friction_model import Equation, Path, blocked_folds

DT_S = 1e-3


def path_of(position, dt_s=DT_S, **more):
    position = np.asarray(position, float)
    return Path(dt_s, position, np.gradient(position, dt_s), np.array([0]), **more)


def wandering(seed=0, seconds=12.0, top=30.0, dt_s=DT_S):
    """A multisine with turning points of every size, fast and slow."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds / dt_s)) * dt_s
    f = np.geomspace(0.2, 12.0, 14)
    wave = (1.0 / f) @ np.sin(2 * np.pi * np.outer(f, t) + rng.uniform(0, 2 * np.pi, f.size)[:, None])
    return path_of(wave * top / (2 * np.pi * np.sqrt(f.size / 2)), dt_s)


def equation_of(model, coefficients, shape, path, noise=0.0, seed=1, inertia=2e-3):
    """What an inertia under this friction exerts, at the path's own rate."""
    rng = np.random.default_rng(seed)
    acceleration = np.gradient(path.velocity, path.dt_s)
    friction = np.asarray(coefficients) @ model.columns(path, np.asarray(shape, float))
    others = np.stack([-acceleration, -np.ones(path.position.size)])
    target = np.array([inertia, 0.01]) @ others - friction + noise * rng.standard_normal(path.position.size)
    return Equation(
        target=target,
        others=others,
        names=("inertia", "offset"),
        path=path,
        fold=blocked_folds(target.size),
        time_s=np.arange(target.size) * path.dt_s,
        process=lambda rows: rows,
    )
