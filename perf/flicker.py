#!/usr/bin/env -S /usr/bin/python3
"""What share of an animated surface is there in one frame only? Looks at the grids alone, never at a mesh.

  perf/flicker.py 'pour/pour.%04d.vdb' 24:30 [--smooth 2]

Needs Debian's python3-numpy, python3-scipy, python3-openvdb. Motion from each frame to the ones before and after it is
found by matching blocks of the level set (windows of 7 voxels, up to 12 voxels far, coarse to fine). A sample of the
surface (a sign change between lattice neighbours half a voxel apart) has a counterpart in another frame when, at the
place it moves to, a sample of that frame's surface lies within --reach voxels whose normal is less than 60 degrees off.
Shares of all samples, which stand for area:
  fresh    without a counterpart in the frame before: no method can keep skin for it
  gone     without one in the frame after
  flicker  without either: the surface is there in this frame only
"""
import argparse
import numpy as np
import pyopenvdb as vdb
from scipy import ndimage
from scipy.spatial import cKDTree

FAR, WINDOW = 5, 7  # coarse voxels searched to each side; voxels of a window
BAND = 2.0  # voxels beyond which distances say nothing


def first_grid(path):
    return vdb.read(path, [g.name for g in vdb.readAllGridMetadata(path) if g.valueTypeName in ("float", "half")][0])


def load(path, lo, hi):
    """The level set in voxels, negative inside; lo and hi in index space."""
    grid = first_grid(path)
    values = np.full(np.array(hi) - lo, grid.background, np.float32)
    grid.copyToArray(values, ijk=tuple(int(i) for i in lo))
    return values / grid.transform.voxelSize()[0]


def box(path):
    return first_grid(path).evalActiveVoxelBoundingBox()


def match(a, b, sites, guess, steps, window):
    """Per site (a voxel of a): its guess and the one of the steps at which b looks most like a in a window."""
    cells = np.array(list(np.ndindex(*[2 * window + 1] * 3))) - window
    flat = lambda x, at: x.ravel()[np.ravel_multi_index(tuple(np.moveaxis(at, -1, 0)), x.shape, mode="clip")]
    here = flat(a, sites[:, None] + cells)
    best, cost = guess.copy(), np.full(len(sites), np.inf)
    for step in steps:
        to = guess + step
        # Among equals, as in the flat, the least motion.
        c = np.abs(here - flat(b, (sites + to)[:, None] + cells)).mean(1) + 1e-3 * np.linalg.norm(to, axis=1)
        better = c < cost
        cost[better], best[better] = c[better], to[better]
    return best


def motion(a, b, points):
    """Displacements in voxels from a to b of points: those of the nearest site, one in each cube of 5 voxels."""
    a, b = np.clip(a, -BAND, BAND), np.clip(b, -BAND, BAND)
    sites = np.unique(np.floor(points / 5).astype(int), axis=0) * 5 + 2
    half = lambda x: ndimage.uniform_filter(x, 2, origin=-1)[::2, ::2, ::2]
    cube = lambda n: [np.array(s) - n for s in np.ndindex(*[2 * n + 1] * 3)]
    coarse = match(half(a), half(b), sites // 2, np.zeros_like(sites), cube(FAR), 1)
    fine = match(a, b, sites, 2 * coarse, cube(2), WINDOW // 2)
    return fine[cKDTree(sites).query(points)[1]]


def samples(phi):
    """Points (in voxels of the array) and normals of the surface, trilinear on half voxels."""
    fine = ndimage.zoom(phi, [(2 * n - 1) / n for n in phi.shape], order=1)
    gradient = np.gradient(ndimage.gaussian_filter(fine, 0.7))
    points, normals = [], []
    for axis in range(3):
        low, high = [slice(None)] * 3, [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        u, v = fine[tuple(low)], fine[tuple(high)]
        at = np.argwhere((u < 0) != (v < 0))
        here = tuple(at.T)
        n = np.stack([g[tuple(low)][here] for g in gradient], 1)
        p = at.astype(float)
        p[:, axis] += u[here] / (u[here] - v[here])
        points.append(p / 2)
        normals.append(n / np.maximum(np.linalg.norm(n, axis=1), 1e-12)[:, None])
    return np.concatenate(points), np.concatenate(normals)


def lacking(now, other, reach):
    """One for every fourth sample of `now`: whether it has no counterpart."""
    points, normals = (x[::4] for x in now[1])  # enough of them
    to = points + motion(now[0], other[0], points)
    distance, near = cKDTree(other[1][0]).query(to, k=48, distance_upper_bound=reach)
    agree = np.einsum("ijk,ik->ij", other[1][1][np.minimum(near, len(other[1][1]) - 1)], normals) > 0.5
    return ~(np.isfinite(distance) & agree).any(1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pattern")
    parser.add_argument("frames", help="A:B; A - 1 and B + 1 must be there")
    parser.add_argument("--reach", type=float, default=1.0)
    parser.add_argument("--smooth", type=int, default=0, help="means over 3x3x3 voxels, about as isoskin's --smooth")
    args = parser.parse_args()
    first, last = map(int, args.frames.split(":"))
    boxes = [box(args.pattern % k) for k in range(first - 1, last + 2)]
    lo, hi = np.min([b[0] for b in boxes], 0) - 4, np.max([b[1] for b in boxes], 0) + 5
    def read(k):
        phi = load(args.pattern % k, lo, hi)
        for _ in range(args.smooth):
            phi = ndimage.uniform_filter(phi, 3)
        return phi, samples(phi)
    before, now, rows = read(first - 1), read(first), []
    for k in range(first, last + 1):
        after = read(k + 1)
        fresh = lacking(now, before, args.reach)
        gone = lacking(now, after, args.reach)
        rows.append([100 * fresh.mean(), 100 * gone.mean(), 100 * (fresh & gone).mean()])
        print("%d: fresh %.1f %%, gone %.1f %%, flicker %.1f %%" % (k, *rows[-1]), flush=True)
        before, now = now, after
    print("mean: fresh %.1f %%, gone %.1f %%, flicker %.1f %%" % tuple(np.mean(rows, 0)))


if __name__ == "__main__":
    main()
