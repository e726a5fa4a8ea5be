"""The material stage bound to a frame: the V-Buffer and a sun's visibility filtered over frames, light after them.

What the temporal filter of in-scattering takes for noise, it averages: lights that move, phase functions that turn.
Here the history holds what light falls on instead [Bauer 2019]: the V-Buffer, and of one directional light, which
light arrives. In-scattering is computed anew in each frame, at the froxels' middles, so a lamp leaves nothing behind
where it has been, and no direction is old. The price is what was not filtered: lamps, and all suns but one, are judged
at a froxel's middle, with no jitter that a filter could average; and the mean of a product is not the product of means,
so where a medium's edge and a shadow's share a froxel its light is off by their covariance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from froxel_ref import blocks, fog_stages, fom_plan, temporal
from froxel_ref.arrays import Field
from froxel_ref.grid import froxel_points
from froxel_ref.jobs import Job, Part, Results
from froxel_ref.light_visibility import light_visibility
from froxel_ref.scene import DirectionalLight, Scene
from froxel_ref.settings import Settings
from froxel_ref.shadow import shadowed_lights
from froxel_ref.temporal_stage import Past, average_parts, filled, guesses, held, holes_part, past_of, weight

__all__ = ["FIELDS", "HISTORY", "filtered_material", "filtered_sun", "material_parts", "nothing_filtered"]

FIELDS = (*fog_stages.FILTERED, "material/sun_light", "material/sun_visibility", "material/guessed", "material/valid")
HISTORY = FIELDS[:-1]
"""What the next frame reads."""

_MATERIAL = ("scattering", "extinction", "emission", "phase_anisotropy")


def filtered_sun(scene: Scene, settings: Settings) -> int | None:
    """The directional light whose visibility is filtered.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    int or None
        The first one that a surface may hide, or a medium or particle dim; None where there is none.

    Notes
    -----
    One, since every light would need a volume of its own [Dörries 2020, §3.2.6].

    Examples
    --------
    >>> from froxel_ref.scene import Plane
    >>> sun = DirectionalLight(direction=(0, 1, 0), irradiance=(1, 1, 1))
    >>> [filtered_sun(Scene(lights=(sun,), surfaces=what), Settings()) for what in ((), (Plane(),))]
    [None, 0]
    """
    found = set(shadowed_lights(scene.all_lights, scene.surfaces)) if settings.shadows != "off" else set()
    if settings.volumetric_shadows != "off":
        found |= fom_plan.dimmed_suns(scene).keys()
    return min((i for i in found if isinstance(scene.all_lights[i], DirectionalLight)), default=None)


def material_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    """What the stage does within itself.

    Parameters
    ----------
    scene : Scene
    settings : Settings

    Returns
    -------
    tuple of Part
    """
    average, *remedies = average_parts(settings, settings.temporal.filter == "media")
    sun = filtered_sun(scene, settings)
    why = "nothing hides a directional light" if sun is None else f"of light {sun}"
    return average, Part("sun's visibility", sun is not None, why), holes_part(settings), *remedies


def nothing_filtered(job: Job) -> dict[str, Field]:
    """What stands for the stage where it is left out: no fields; lighting reads what came before.

    Parameters
    ----------
    job : Job

    Returns
    -------
    dict of str to ndarray
        Arrays with axes of length 0.
    """
    empty = {name: np.zeros((3, 0, 0, 0), job.dtype) for name in ("material/scattering", "material/emission")}
    empty |= {name: np.zeros((0, 0, 0), job.dtype) for name in (
        "material/extinction", "material/phase_anisotropy", "material/sun_visibility", "material/guessed",
        "material/valid")}
    return empty | {"material/lobe_scattering": np.zeros((0, 3, 0, 0, 0), job.dtype),
                    "material/lobe_anisotropy": np.zeros(0, job.dtype), "material/sun_light": np.zeros(0, np.int64)}


def filtered_material(job: Job, results: Results) -> dict[str, Field]:
    """Filter the V-Buffer and the visibility of a sun.

    Parameters
    ----------
    job : Job
    results : mapping of str to Field
        With ``media/…``, and the maps that the settings ask for.

    Returns
    -------
    dict of str to Field
        ``material/…``, of the whole grid.

    Notes
    -----
    The average is that of the temporal stage: S + α(Y − S), S fetched where the froxel's middle was, Y at the jittered
    sample [Dörries 2020, §3.2.3], with its clamps and weights: one weight for the whole material, the largest that a
    field of it asks for, lest more be scattered than extinguished; another one for the visibility. g is averaged by
    what scatters, or plainly as ``phase_mixing`` has it (D12): an empty sample has no g that could count.

    A checkerboard's holes are filled as everywhere: with their history, or the mean of their neighbours. Light is then
    computed in half of the froxels, and `froxel_ref.temporal_stage` fills its holes, from a frame ago. A history of
    other lobes (``phase_mixing`` "mixture") is none, nor is one of another sun's visibility.

    An EMA of α answers a shadow that moves as the filter of in-scattering does: (1 − α)ⁿ of it is left after n frames.
    """
    if job.settings.temporal.filter != "media":  # forced, but not to what was switched off
        return nothing_filtered(job)
    past = past_of(job, "material/scattering")
    like = past if past is not None and _is_like(past, results) else None
    old_guess, guess = guesses(job, True) if like is None else guesses(
        job, True, like.history.fields.get("material/guessed"), like.place)
    made = _material(job, results, like, old_guess)
    valid = np.zeros((1, 1, 1), job.dtype) if past is None else past.place.valid.astype(job.dtype)
    return made | _sun(job, results, past, old_guess) | {"material/guessed": guess, "material/valid": valid}


def _is_like(past: Past, results: Results) -> bool:
    """Whether a history is of fields like this frame's."""
    fields = past.history.fields
    return (np.array_equal(fields["material/lobe_anisotropy"], results["media/lobe_anisotropy"])
            and fields["material/extinction"].ndim == results["media/extinction"].ndim)


# --- the V-Buffer -----------------------------------------------------------------------------------


def _material(job: Job, results: Results, past: Past | None, guessed: Field | None) -> dict[str, Field]:
    """The V-Buffer without holes, averaged where it has a history."""
    fields = {name: results[f"media/{name}"] for name in _MATERIAL}
    lobes = results["media/lobe_scattering"]
    if len(lobes):
        fields["lobe_scattering"] = lobes.reshape(-1, *lobes.shape[2:])
    if past is None:
        made = {name: filled(job, field) for name, field in fields.items()}
    else:
        made = _averaged(job, fields, past, guessed)
    made["lobe_scattering"] = made["lobe_scattering"].reshape(
        len(lobes), 3, *made["lobe_scattering"].shape[1:]) if len(lobes) else lobes
    return {f"material/{name}": field for name, field in made.items()} | {
        "material/lobe_anisotropy": results["media/lobe_anisotropy"]}


def _averaged(job: Job, fields: dict[str, Field], past: Past, guessed: Field | None) -> dict[str, Field]:
    names = list(fields)
    old = {name: _old_anisotropy(job, past) if name == "phase_anisotropy" else
           past.fetch(_flat(past.history.fields[f"material/{name}"]).astype(job.dtype, copy=False), job)
           for name in names}
    new = {name: filled(job, fields[name], old[name], past.place.valid) for name in names}
    old = {name: held(job, old[name], new[name]) for name in names}
    share = weight(job, list(new.values()), list(old.values()), guessed)
    made = {name: temporal.blend(new[name], old[name], past.place.valid, alpha=share)
            for name in names if name != "phase_anisotropy"}
    g, before = new["phase_anisotropy"], old["phase_anisotropy"]
    if g.size == before.size == 1 and g == before:
        return made | {"phase_anisotropy": g}
    if job.settings.phase_mixing != "mean":
        share = _by_scattering(share, new["scattering"], old["scattering"])
    return made | {"phase_anisotropy": temporal.blend(g, before, past.place.valid, alpha=share)}


def _flat(field: Field) -> Field:
    """Lobes and their channels along one axis."""
    return field.reshape(-1, *field.shape[2:]) if field.ndim == 5 else field


def _by_scattering(share: Field, now: Field, before: Field) -> Field:
    """This frame's weight in the mean of what counts by how much of it scatters; all where nothing did before."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        new, old = share * now.sum(axis=0), (1.0 - share) * before.sum(axis=0)
        return np.where(new + old > 0.0, new / (new + old), 1.0)


def _old_anisotropy(job: Job, past: Past) -> Field:
    """g as it was where the froxels were, weighted by what scattered (D12)."""
    g = past.history.fields["material/phase_anisotropy"].astype(job.dtype, copy=False)
    plain = past.fetch(g, job)
    if plain is g or job.settings.phase_mixing == "mean":
        return plain
    scattering = past.history.fields["material/scattering"].astype(job.dtype, copy=False).sum(axis=0)
    total = past.fetch(scattering, job)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        mean = past.fetch(g * scattering, job) / total
    low, high = (choose.reduce(g, axis=None) for choose in (np.fmin, np.fmax))  # past what is no number
    return np.clip(np.where(total > 0.0, mean, plain), low, high)


# --- the sun ----------------------------------------------------------------------------------------


def _sun(job: Job, results: Results, past: Past | None, guessed: Field | None) -> dict[str, Field]:
    """The first hidden sun's visibility, averaged where it has a history."""
    number = filtered_sun(job.scene, job.settings)
    if number is None:
        return {name: nothing_filtered(job)[name] for name in ("material/sun_light", "material/sun_visibility")}
    seen = _seen(job, results, number)
    if past is None or past.history.fields["material/sun_light"].tolist() != [number]:
        seen = filled(job, seen)
    else:
        old = past.field("material/sun_visibility", job)
        seen = filled(job, seen, old, past.place.valid)
        old = held(job, old, seen)
        seen = temporal.blend(seen, old, past.place.valid, alpha=weight(job, [seen], [old], guessed))
    return {"material/sun_light": np.array([number]), "material/sun_visibility": seen}


def _seen(job: Job, results: Results, number: int) -> Field:
    """A light's visibility at this frame's samples, as stored: of a checkerboard half the slices."""
    sight = light_visibility(job, results)[number]
    name = "material/sun_visibility"

    def make(part: fog_stages.Piece, run: fog_stages.Run) -> dict[str, Field]:
        field = run.room(name)((len(part.froxels.depths), *part.froxels.rays.length.shape), job.dtype)

        def block(box: Sequence[slice]) -> None:
            field[box[0], box[1]] = sight(froxel_points(part.froxels, *box))

        blocks.run(block, blocks.blocks(*field.shape), threads=run.threads)
        return {name: field}

    return fog_stages.assembled(job, fog_stages.pieces(job), make)[name]
