"""Train the networks of `apes`, `apes-global` and `potamias` on the shapes of training_set.py: needs PyTorch.

    python benchmarks/learned/train.py apes|apes-global|potamias [epochs]

Writes the weights to gppcs_learned, prints their digest, and writes the curve of the loss to benchmarks/results. A GPU
is used if there is one. Seeds are fixed.
"""

from __future__ import annotations

import csv
import hashlib
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

try:
    import torch
    from torch import Tensor, nn
except ImportError as error:
    raise SystemExit("training needs PyTorch, which is not installed: pip install torch") from error

sys.path.insert(0, str(Path(__file__).parents[1]))
import training_set
from gppcs_learned.weights import FOLDER, LATENT, NEIGHBOURS

ROOT = Path(__file__).parents[2]
DEVICE = "cuda" if torch.cuda.is_available() else "cpu"
POINTS, DRAWN, BATCH = 1024, 2048, 8  # of a cloud in a step, of a cloud drawn once, clouds of a step
EPOCHS = {"apes": 6, "apes-global": 6, "potamias": 4}
WIDTH, HEADS, SLOPE = 64, 4, 0.2  # features of a point, heads of an attention, slope of LeakyReLU


def neighbours(points: Tensor) -> Tensor:
    """Return the nearest others of each point. Shapes: points (B, N, 3); returns (B, N, k)."""
    return torch.cdist(points, points).topk(NEIGHBOURS + 1, largest=False).indices[:, :, 1:]


def gathered(values: Tensor, index: Tensor) -> Tensor:
    """Return the rows of each cloud that the index names. Shapes: values (B, N, c), index (B, ...)."""
    rows = index.reshape(len(index), -1, 1).expand(-1, -1, values.shape[2])
    return values.gather(1, rows).reshape(*index.shape, values.shape[2])


class Normed(nn.Module):
    """Batch normalisation of the last axis."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.BatchNorm1d(width)

    def forward(self, values: Tensor) -> Tensor:
        """Normalise (..., width)."""
        return self.norm(values.reshape(-1, values.shape[-1])).reshape(values.shape)

    def line(self) -> tuple[Tensor, Tensor]:
        """Return the factor and the shift that it amounts to after training, (width,) each."""
        factor = self.norm.weight / torch.sqrt(self.norm.running_var + self.norm.eps)
        return factor, self.norm.bias - self.norm.running_mean * factor


class EdgeConv(nn.Module):
    """Two layers on (centre, difference) of each pair of neighbours, and their maximum."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.centre, self.difference = nn.Linear(width, 32, bias=False), nn.Linear(width, 32, bias=False)
        self.second, self.norms = nn.Linear(32, 32, bias=False), nn.ModuleList([Normed(32), Normed(32)])

    def forward(self, centre: Tensor, difference: Tensor) -> Tensor:
        """Return features, (B, N, 32), of centres, (B, N, c), and of differences, (B, N, k, 32), already weighed."""
        edges = nn.functional.leaky_relu(self.norms[0](self.centre(centre)[:, :, None] + difference), SLOPE)
        return nn.functional.leaky_relu(self.norms[1](self.second(edges)), SLOPE).amax(2)

    def arrays(self) -> dict[str, Tensor]:
        """Return what NumPy needs."""
        (first, shift), (second, shift_2) = (norm.line() for norm in self.norms)
        return {
            "centre": self.centre.weight.T * first, "difference": self.difference.weight.T * first, "shift": shift,
            "second": self.second.weight.T * second, "shift_2": shift_2,
        }  # fmt: skip


class Embedding(nn.Module):
    """Two EdgeConv blocks, joined: features (B, N, 64) of points."""

    def __init__(self) -> None:
        super().__init__()
        self.first, self.second = EdgeConv(3), EdgeConv(32)

    def forward(self, points: Tensor, index: Tensor) -> Tensor:
        """Return features of the points, (B, N, 3)."""
        steps = gathered(points, index) - points[:, :, None]
        steps = steps / steps[:, :, -1:].norm(dim=3, keepdim=True)
        one = self.first(points, self.first.difference(steps))
        weighed = self.second.difference(one)
        return torch.cat([one, self.second(one, gathered(weighed, index) - weighed[:, :, None])], 2)


class Attention(nn.Module):
    """Neighbour-to-point attention with a feed-forward layer."""

    def __init__(self) -> None:
        super().__init__()
        self.query, self.key, self.value = (nn.Linear(WIDTH, WIDTH, bias=False) for _ in range(3))
        self.up, self.down = nn.Linear(WIDTH, 2 * WIDTH, bias=False), nn.Linear(2 * WIDTH, WIDTH, bias=False)
        self.norms = nn.ModuleList([Normed(WIDTH), Normed(WIDTH)])

    def forward(self, features: Tensor, index: Tensor) -> Tensor:
        """Return features, (B, N, c), of features, (B, N, c)."""
        shape = (*index.shape, HEADS, WIDTH // HEADS)
        key, value = self.key(features), self.value(features)
        keys = (gathered(key, index) - key[:, :, None]).reshape(shape)
        query = self.query(features).reshape(*index.shape[:2], 1, HEADS, -1)
        weights = torch.softmax((query * keys).sum(4) / (WIDTH // HEADS) ** 0.5, 2)
        values = (weights[..., None] * gathered(value, index).reshape(shape)).sum(2).reshape(value.shape) - value
        features = self.norms[0](features + values)
        return self.norms[1](features + self.down(nn.functional.leaky_relu(self.up(features), SLOPE)))

    def arrays(self) -> dict[str, Tensor]:
        """Return what NumPy needs."""
        layers = {name: getattr(self, name).weight.T for name in ("query", "key", "value", "up", "down")}
        lines = [norm.line() for norm in self.norms]
        return {**layers, "factors": torch.stack([a for a, _ in lines]), "shifts": torch.stack([b for _, b in lines])}


class Downsampling(nn.Module):
    """Attention whose weights score the points: local, by their standard deviation; global, by what a point gets."""

    def __init__(self, everywhere: bool) -> None:
        super().__init__()
        self.query, self.key, self.value = (nn.Linear(WIDTH, WIDTH, bias=False) for _ in range(3))
        self.everywhere = everywhere

    def forward(self, features: Tensor, index: Tensor) -> tuple[Tensor, Tensor]:
        """Return the scores, (B, N), and the features of all points, (B, N, c)."""
        query, key, value = (layer(features) for layer in (self.query, self.key, self.value))
        if self.everywhere:
            weights = torch.softmax(query @ key.transpose(1, 2) / WIDTH**0.5, 2)
            return weights.sum(1), weights @ value
        keys = gathered(key, index) - key[:, :, None]
        weights = torch.softmax((query[:, :, None] * keys).sum(3) / WIDTH**0.5, 2)
        return weights.std(2, correction=0), (weights[..., None] * gathered(value, index)).sum(2)

    def arrays(self) -> dict[str, Tensor]:
        """Return what NumPy needs."""
        return {"query": self.query.weight.T, "key": self.key.weight.T}


class Apes(nn.Module):
    """The network of APES: keeps half of the points twice; classifies the shape."""

    def __init__(self, everywhere: bool) -> None:
        super().__init__()
        self.embedding = Embedding()
        self.attentions = nn.ModuleList(Attention() for _ in range(3))
        self.downsamplings = nn.ModuleList(Downsampling(everywhere) for _ in range(2))
        self.heads = nn.ModuleList(nn.Sequential(nn.Linear(WIDTH, 256), nn.LeakyReLU(SLOPE)) for _ in range(3))
        self.classes = nn.Sequential(
            nn.Linear(768, 128), nn.BatchNorm1d(128), nn.LeakyReLU(SLOPE), nn.Dropout(0.3),
            nn.Linear(128, len(training_set.KINDS)),
        )  # fmt: skip

    def forward(self, points: Tensor) -> Tensor:
        """Return the logits of the kinds of clouds, (B, N, 3)."""
        index = neighbours(points)
        features = self.attentions[0](self.embedding(points, index), index)
        seen = [self.heads[0](features).amax(1)]
        for stage, downsampling in enumerate(self.downsamplings):
            scores, features = downsampling(features, index)
            kept = scores.topk(points.shape[1] // 2).indices
            points, features = gathered(points, kept), gathered(features, kept)
            index = neighbours(points)
            features = self.attentions[stage + 1](features, index)
            seen.append(self.heads[stage + 1](features).amax(1))
        return self.classes(torch.cat(seen, 1))


class Potamias(nn.Module):
    """The network of Potamias et al.: a latent space, in which points are chosen, and an attention that moves them."""

    def __init__(self) -> None:
        super().__init__()
        self.embedding, self.latent = Embedding(), nn.Linear(WIDTH, 8, bias=False)
        self.query, self.key = nn.Linear(WIDTH, 32, bias=False), nn.Linear(WIDTH, 32, bias=False)
        self.saliency = nn.Linear(8, 1)  # a read-out for training, so that the latent space keeps the curvature

    def forward(self, points: Tensor, index: Tensor, n_kept: int) -> tuple[Tensor, Tensor]:
        """Return the moved points, (B, M, 3), and the saliency that the latent space tells, (B, N)."""
        features = self.embedding(points, index)
        latent = torch.tanh(self.latent(features))
        kept = farthest(torch.cat([points, LATENT * latent], 2).detach(), n_kept)
        around = torch.cat([kept[:, :, None], gathered(index, kept)], 2)
        query, key = gathered(self.query(features), kept), gathered(self.key(features), around)
        weights = torch.softmax((query[:, :, None] * key).sum(3) / 32**0.5, 2)
        return (weights[..., None] * gathered(points, around)).sum(2), self.saliency(latent)[:, :, 0]


def farthest(latent: Tensor, n_kept: int) -> Tensor:
    """Choose farthest points, the first farthest from the mean. Shapes: latent (B, N, c); returns (B, n_kept)."""
    nearest, chosen = (latent - latent.mean(1, keepdim=True)).square().sum(2), []
    for step in range(n_kept):
        chosen.append(nearest.argmax(1))
        squared = (latent - gathered(latent, chosen[-1][:, None])).square().sum(2)
        nearest = squared if step == 0 else torch.minimum(nearest, squared)
    return torch.stack(chosen, 1)


def loss_of_apes(network: Apes, points: Tensor, normals: Tensor, kinds: Tensor, rng: np.random.Generator) -> Tensor:
    """Return the cross entropy of the kinds."""
    return nn.functional.cross_entropy(network(points), kinds, label_smoothing=0.2)


def loss_of_potamias(
    network: Potamias, points: Tensor, normals: Tensor, kinds: Tensor, rng: np.random.Generator
) -> Tensor:
    """Return the Chamfer distance, weighted by saliency, plus the error of the saliency that the latent space tells."""
    index, n_kept = neighbours(points), int(POINTS * rng.uniform(0.05, 0.4))
    saliency = (gathered(normals, index) - normals[:, :, None]).norm(dim=3).mean(2)
    moved, told = network(points, index, n_kept)
    distances = torch.cdist(points, moved).square()
    weights = 0.5 + saliency / saliency.mean(1, keepdim=True).clamp_min(1e-3)
    chamfer = (weights * distances.amin(2)).mean() + distances.amin(1).mean()
    return n_kept * chamfer + (told - saliency).square().mean()


def made(epoch_rng: np.random.Generator, clouds: np.ndarray, rows: np.ndarray) -> tuple[Tensor, Tensor]:
    """Return points and normals, (B, N, 3), of some clouds, (n, DRAWN, 6): a random part, turned and scaled."""
    points, normals = [], []
    for cloud in clouds[rows]:
        part = cloud[epoch_rng.permutation(DRAWN)[:POINTS]]
        turn = np.linalg.qr(epoch_rng.standard_normal((3, 3)))[0]
        centred = part[:, :3] - part[:, :3].mean(axis=0)
        points.append(centred / np.linalg.norm(centred, axis=1).max() @ turn.T)
        normals.append(part[:, 3:] @ turn.T)
    return tuple(torch.tensor(np.array(values), dtype=torch.float32, device=DEVICE) for values in (points, normals))


def arrays_of(network: nn.Module) -> dict[str, np.ndarray]:
    """Return the weights that NumPy needs, by name."""
    arrays = {}
    for name, module in network.named_modules():
        if hasattr(module, "arrays") and not name.endswith((".1", ".2")):  # the first stage scores all points
            arrays |= {f"{name}.{key}": value for key, value in module.arrays().items()}
    if isinstance(network, Potamias):
        arrays |= {name: getattr(network, name).weight.T for name in ("latent", "query", "key")}
    return {name: value.detach().cpu().numpy().astype(np.float32) for name, value in arrays.items()}


NETWORKS: dict[str, tuple[Callable[[], nn.Module], Callable[..., Tensor]]] = {
    "apes": (lambda: Apes(False), loss_of_apes),
    "apes-global": (lambda: Apes(True), loss_of_apes),
    "potamias": (Potamias, loss_of_potamias),
}


def main() -> None:
    """Train one network, and write its weights and its curve."""
    name = sys.argv[1]
    epochs = int(sys.argv[2]) if len(sys.argv) > 2 else EPOCHS[name]
    torch.manual_seed(0)
    rng, start = np.random.default_rng(0), time.process_time()
    kinds, numbers = np.divmod(np.arange(len(training_set.KINDS) * training_set.PER_KIND), training_set.PER_KIND)
    clouds = np.array(
        [np.hstack(training_set.draw(kind, number, DRAWN)) for kind, number in zip(kinds, numbers, strict=True)]
    )
    make, loss_of = NETWORKS[name]
    network, curve, steps = make().to(DEVICE), [], len(clouds) // BATCH
    optimiser = torch.optim.Adam(network.parameters(), lr=2e-3, weight_decay=1e-5)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 2e-3, total_steps=epochs * steps)
    for epoch in range(epochs):
        losses = []
        for rows in rng.permutation(len(clouds))[: steps * BATCH].reshape(steps, BATCH):
            points, normals = made(rng, clouds, rows)
            loss = loss_of(network, points, normals, torch.tensor(kinds[rows], device=DEVICE), rng)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            losses.append(loss.item())
        curve.append((epoch + 1, f"{np.mean(losses):.4f}", f"{time.process_time() - start:.0f}"))
        print(*curve[-1], flush=True)
    path = FOLDER / f"{name}.npz"
    np.savez(path, **arrays_of(network.eval()))
    print(path, hashlib.sha256(path.read_bytes()).hexdigest())
    with (ROOT / "benchmarks" / "results" / f"learned_{name}.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("epoch", "mean loss", "CPU seconds"), *curve])


if __name__ == "__main__":
    main()
