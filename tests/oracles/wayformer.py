"""Encodes observations with given parameters in loops, in float64 (Wayformer family).

Written from Nayakanti et al. 2022, section 3, and Vaswani et al. 2017. A scene is a
mapping from (token, time) to embedding, in which absent tokens do not stand.
"""

import math

import numpy as np

NORM_EPSILON = 1e-6


def gelu(x):
    """Returns the approximation by tanh (Hendrycks and Gimpel 2016)."""
    return 0.5 * x * (1 + np.tanh(math.sqrt(2 / math.pi) * (x + 0.044715 * x**3)))


def linear(params, x):
    """Applies weights, and a bias where there is one."""
    return x @ params["kernel"] + params.get("bias", 0.0)


def norm(params, x):
    """Gives one vector zero mean and unit variance, then scales and shifts it."""
    normed = (x - x.mean()) / np.sqrt(x.var() + NORM_EPSILON)
    return normed * params["scale"] + params["bias"]


def meet(params, num_heads, query, tokens):
    """Returns what one query gathers from a list of tokens."""
    depth = len(query) // num_heads
    heads = np.zeros(len(query))
    for start in range(0, len(query), depth):
        part = slice(start, start + depth)
        q = linear(params["query"], query)[part]
        scores = [q @ linear(params["key"], t)[part] / math.sqrt(depth) for t in tokens]
        weights = [math.exp(score) for score in scores]
        for weight, token in zip(weights, tokens, strict=True):
            value = linear(params["value"], token)[part]
            heads[part] += weight / sum(weights) * value
    return linear(params["out"], heads)


def block(params, num_heads, query, tokens):
    """Returns one query after a layer."""
    normed = [norm(params["token_norm"], token) for token in tokens]
    query = query + meet(
        params["attention"], num_heads, norm(params["query_norm"], query), normed
    )
    hidden = gelu(linear(params["expand"], norm(params["mlp_norm"], query)))
    return query + linear(params["contract"], hidden)


def embed(params, group):
    """Returns {(token, time): embedding} of what is present in a group."""
    values, mask = group
    return {
        (token, time): linear(params["projection"], values[token, time])
        + params["step_embedding"]["embedding"][time]
        + (
            params["position_embedding"]["embedding"][token]
            if "position_embedding" in params
            else 0.0
        )
        for token, time in np.argwhere(mask)
    }


def encode(params, scene, axes, num_heads, num_steps):
    """Applies an encoder to a scene {(token, time): embedding}, along axes by layer."""
    if "latents" in params:
        latents = params["latents"]["embedding"]
        scene = {
            (number, time): block(
                params["cross"],
                num_heads,
                latent,
                [x for (_, other), x in sorted(scene.items()) if other == time],
            )
            for time in range(num_steps)
            for number, latent in enumerate(latents)
        }
    for layer, axis in enumerate(axes):
        fixed = {"time": 0, "space": 1}[axis]  # attends where the other axis agrees
        scene = {
            place: block(
                params["blocks"][layer],
                num_heads,
                x,
                [
                    y
                    for other, y in sorted(scene.items())
                    if other[fixed] == place[fixed]
                ],
            )
            for place, x in scene.items()
        }
    return scene


def flatten(scene):
    """Makes a token of every place, all at one time."""
    return {(number, 0): x for number, (_, x) in enumerate(sorted(scene.items()))}


def join(scenes, steps, num_steps):
    """Puts scenes side by side; what has one step is there all the time."""
    joint, first = {}, 0
    for scene, own in zip(scenes, steps, strict=True):
        for (token, time), x in scene.items():
            for moment in range(num_steps) if own == 1 else [time]:
                joint[first + token, moment] = x
        first += 1 + max((token for token, _ in scene), default=0)
    return joint


def pool(params, scene):
    """Returns the mean over all that is present."""
    return np.mean([norm(params["norm"], x) for x in scene.values()], axis=0)
