"""The stage table: what each stage reads and writes, when a scene needs it, and what it stands for when not.

This is the one list of stages. The frame driver, plans, golden sets, timings and `explain` all read it.
A stage here only binds named arrays to the plain functions of its module.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from froxel_ref import (
    apply,
    culling,
    fog_stages,
    fom_plan,
    fom_stage,
    grid,
    integrate,
    long_range_stage,
    material_stage,
    media,
    shadow_stage,
    surface,
    taa_stage,
    temporal_stage,
    transparency_stage,
)
from froxel_ref.arrays import Field, FogAt
from froxel_ref.buffers import Integrated
from froxel_ref.jobs import Job, Need, Part, Results, Stage
from froxel_ref.light_visibility import light_visibility
from froxel_ref.quantities import AVERAGED, FINAL
from froxel_ref.scene import (
    BLACK,
    DirectionalLight,
    LocalMedium,
    Medium,
    PointLight,
    Scene,
)
from froxel_ref.settings import Settings
from froxel_ref.shadow import shadowed_lights

__all__ = ["STAGES"]


def _constant(job: Job, axes: str, value: float | tuple[float, float, float]) -> Field:
    channels = (-1,) if "c" in axes else ()
    return np.reshape(np.asarray(value, job.dtype), channels + (1,) * len(axes.replace("c", "")))


def _some(items: object, yes: str, no: str) -> Need:
    return (True, yes) if items else (False, no)


def _count(number: int, thing: str, things: str = "") -> str:
    return f"{number} {thing if number == 1 else things or thing + 's'}"


def _media_count(number: int) -> str:
    return _count(number, "medium", "media")


# --- grid -------------------------------------------------------------------------------------------


def _run_grid(job: Job, results: Results) -> dict[str, Field]:
    return {"grid/slice_depth": job.centres.boundaries[1:, 0, 0]}


# --- surface ----------------------------------------------------------------------------------------


def _needs_surface(scene: Scene, settings: Settings) -> Need:
    if scene.image_buffers is not None:
        return True, "the scene brings its own depth buffer"
    return _some(scene.surfaces, _count(len(scene.surfaces), "surface"), "the scene has no surfaces")


def _neutral_surface(job: Job) -> dict[str, Field]:
    return {"surface/depth": _constant(job, "yx", np.inf),
            "surface/normal": _constant(job, "cyx", BLACK), "surface/albedo": _constant(job, "cyx", BLACK),
            "surface/radiance": _constant(job, "cyx", job.scene.background)}


def _run_surface(job: Job, results: Results) -> dict[str, Field]:
    if job.scene.image_buffers is not None:
        hits, radiance = surface.imported(job.assets, job.scene, dtype=job.dtype)
    else:
        hits = surface.find_surfaces(job.scene.surfaces, job.image_rays, job.assets, threads=job.threads,
                                     restrict=not job.full)
        radiance = surface.shade(hits, job.image_rays, job.scene, attenuation=job.settings.attenuation,
                                 visibility=light_visibility(job, results), threads=job.threads, restrict=not job.full)
    return {"surface/depth": hits.depth, "surface/normal": hits.normal, "surface/albedo": hits.albedo,
            "surface/radiance": radiance}


# --- culling ----------------------------------------------------------------------------------------


def _bounded_lights(scene: Scene) -> dict[int, PointLight]:
    """The lights that have an end and give light, by index: all that is in lists."""
    lamps = {i: light for i, light in enumerate(scene.all_lights) if isinstance(light, PointLight)}
    return {i: light for i, light in lamps.items()
            if light.falloff == "windowed" and any(light.intensity or light.power or ())}


def _bounded_media(scene: Scene, settings: Settings) -> dict[int, LocalMedium]:
    """The local media that add something, by index; the plain mean of g counts the others, too (D12)."""
    idle = settings.phase_mixing == "mean"
    return {i: medium for i, medium in enumerate(scene.local_media) if idle or media.contributing((medium,))}


def _needs_culling(scene: Scene, settings: Settings) -> Need:
    lights, local = len(_bounded_lights(scene)), len(_bounded_media(scene, settings))
    found = [_count(lights, "light")] * bool(lights) + [_count(local, "local medium", "local media")] * bool(local)
    return _some(found, "bounded: " + ", ".join(found), "the scene has no lights with a window and no local media")


def _culling_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    lights, local = len(_bounded_lights(scene)), len(_bounded_media(scene, settings))
    return (Part("lists of lights", *_some(lights, _count(lights, "light"), "the scene has none with a window")),
            Part("lists of local media", *_some(local, _media_count(local), "the scene has none")))


def _named(lights: culling.Culled, local: culling.Culled) -> dict[str, Field]:
    return {f"culling/{kind}_{name}": array for kind, lists in (("light", lights), ("medium", local))
            for name, array in lists._asdict().items()}


def _neutral_culling(job: Job) -> dict[str, Field]:
    tiling = fog_stages.fog_tiling(job)
    return _named(culling.cull_lights({}, tiling), culling.cull_media({}, tiling))


def _run_culling(job: Job, results: Results) -> dict[str, Field]:
    scene, tiling, origin = job.scene, fog_stages.fog_tiling(job), job.scene.camera.position
    return _named(culling.cull_lights(_bounded_lights(scene), tiling, origin=origin, dtype=job.dtype),
                  culling.cull_media(_bounded_media(scene, job.settings), tiling, origin=origin, dtype=job.dtype))


# --- media ------------------------------------------------------------------------------------------


def _media(scene: Scene) -> tuple[Medium, ...]:
    return media.contributing(scene.global_media + scene.local_media)


def _needs_media(scene: Scene, settings: Settings) -> Need:
    """Whether the stage runs by itself, and not with lighting in one."""
    return (False, "merged with lighting") if settings.merged else _has_media(scene, settings)


def _has_media(scene: Scene, settings: Settings) -> Need:
    idle = scene.global_media + scene.local_media
    if idle and not _media(scene) and settings.phase_mixing == "mean":
        return True, "the plain mean of g counts media that are not there (D12)"
    return _some(_media(scene), _media_count(len(_media(scene))),
                 "the scene has no medium with extinction or emission")


def _media_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    found = _media(scene)
    local = [medium for medium in found if isinstance(medium, LocalMedium)]
    everywhere = len(found) - len(local)
    fog = sum(medium.height_fog is not None for medium in found)
    textures = sum(medium.density is not None for medium in found)
    return (
        Part("global media", *_some(everywhere, _media_count(everywhere), "the scene has none")),
        Part("local media", *_some(local, _media_count(len(local)), "the scene has none")),
        Part("height fog", *_some(fog, "in " + _media_count(fog), "no medium has it")),
        Part("density textures", *_some(textures, "in " + _media_count(textures), "no medium has one")),
    )


def _neutral_media(job: Job) -> dict[str, Field]:
    black, nothing = _constant(job, "czyx", BLACK), _constant(job, "zyx", 0.0)
    if job.settings.merged and _media(job.scene):  # made and forgotten slab by slab
        black, nothing = black[:, :0], nothing[:0]
    return {"media/albedo": black, "media/scattering": black, "media/extinction": nothing, "media/emission": black,
            "media/phase_anisotropy": nothing} | fog_stages.lobe_fields((), job.dtype)


# --- shadow -----------------------------------------------------------------------------------------


def _run_shadow(job: Job, results: Results) -> dict[str, Field]:
    if job.settings.shadows != "maps":  # forced, but not to what was switched off
        return shadow_stage.empty_maps(job.settings, job.dtype)
    return shadow_stage.shadow_maps(job.scene, job.settings, job.assets, dtype=job.dtype, threads=job.threads,
                                    known=results)


def _shadow_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    return tuple(Part(f"{kind} lights", *_some(found, _count(len(found), "light"), "none that a surface may hide"))
                 for kind, found in shadow_stage.map_lights(scene).items())


# --- fom --------------------------------------------------------------------------------------------


def _run_fom(job: Job, results: Results) -> dict[str, Field]:
    if job.settings.volumetric_shadows != "maps":  # forced, but not to what was switched off
        return fom_stage.empty_maps(job.settings, job.dtype)
    return fom_stage.opacity_maps(job.scene, job.settings, job.assets, dtype=job.dtype, threads=job.threads,
                                  known=results)


# --- material ---------------------------------------------------------------------------------------


def _needs_material(scene: Scene, settings: Settings) -> Need:
    if settings.temporal.filter != "media":
        return False, "no temporal filter of media"
    return True, "filter: media"  # media that are no more there may be remembered


# --- lighting ---------------------------------------------------------------------------------------


def _sources(scene: Scene, settings: Settings) -> list[str]:
    emits = any(any(medium.emissive) for medium in _media(scene))
    ambient = any(scene.ambient) or settings.ambient == "constant"
    found = {"lights": bool(scene.all_lights), "ambient": ambient, "emission": emits}
    return [name for name, there in found.items() if there]


def _needs_lighting(scene: Scene, settings: Settings) -> Need:
    """Whether the stage runs by itself, and not with media in one."""
    return (False, "merged with media") if settings.merged else _has_light(scene, settings)


def _has_light(scene: Scene, settings: Settings) -> Need:
    if settings.temporal.filter == "media":
        return True, "media that are no more there may be remembered (filter: media)"
    if not _media(scene):
        return False, "there is no medium to scatter light"
    sources = _sources(scene, settings)
    return _some(sources, "the medium receives or emits light: " + ", ".join(sources),
                 "no lights, no ambient light and no emission")


def _dims(scene: Scene, settings: Settings) -> Need:
    """Whether media or particles dim a light."""
    return fom_plan.dims_light(scene, settings), fom_plan.needs_maps(scene, settings)[1]


def _lighting_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    suns = sum(isinstance(light, DirectionalLight) for light in scene.all_lights)
    local, sources = len(scene.all_lights) - suns, _sources(scene, settings)
    casts, why = shadow_stage.needs_maps(scene, settings)
    if settings.shadows == "exact":
        found = shadowed_lights(scene.all_lights, scene.surfaces)
        casts, why = bool(found), why if found else "the scene has nothing that hides a light"
    return (
        Part("directional lights", *_some(suns, _count(suns, "light"), "the scene has none")),
        Part("point and spot lights", *_some(local, _count(local, "light"), "the scene has none")),
        Part("shadows", casts, why),
        Part("volumetric shadows", *_dims(scene, settings)),
        Part("ambient light", *_some("ambient" in sources, "the scene has it", "the scene's is black")),
        Part("emission", *_some("emission" in sources, "a medium emits", "no medium emits")),
    )


def _neutral_lighting(job: Job) -> dict[str, Field]:
    return {"lighting/in_scattering": _constant(job, "czyx", BLACK),
            "lighting/phase_ratio": np.zeros((3, 0, 0, 0), job.dtype)}


# --- merged -----------------------------------------------------------------------------------------


def _needs_merged(scene: Scene, settings: Settings) -> Need:
    return _has_media(scene, settings) if settings.merged else (False, "media and lighting are stages of their own")


def _merged_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    return _media_parts(scene, settings) + _lighting_parts(scene, settings)


# --- temporal ---------------------------------------------------------------------------------------


def _needs_temporal(scene: Scene, settings: Settings) -> Need:
    return temporal_stage.needs_filter(settings)  # fog that is no more there may be remembered


# --- integrate --------------------------------------------------------------------------------------


def _needs_integrate(scene: Scene, settings: Settings) -> Need:
    if settings.integrator in ("published", "simple") and not _media(scene):
        return True, f"the integrator {settings.integrator!r} dims even a vacuum (D3)"
    fog = _has_media(scene, settings)
    if not fog[0] and (settings.checkerboard or settings.temporal.filter != "off"):
        return True, "fog that is no more there may be remembered"
    return fog


def _neutral_integrate(job: Job) -> dict[str, Field]:
    return {"integrate/radiance": _constant(job, "czyx", BLACK),
            "integrate/transmittance": _constant(job, "zyx", 1.0),
            "integrate/front_radiance": _constant(job, "cyx", BLACK),
            "integrate/front_transmittance": _constant(job, "yx", 1.0)}


def _run_integrate(job: Job, results: Results) -> dict[str, Field]:
    step, length = grid.step_lengths(job.centres)
    how = job.settings
    whole = integrate.integrate(
        *temporal_stage.fog_fields(results), step, length, near=how.grid.near,
        integrator=how.integrator, integrate_from=how.integrate_from, depths=job.centres.depths,
        compensated=how.accumulation == "compensated" and how.integrator == "analytic", threads=job.threads)
    return {f"integrate/{name}": field for name, field in whole._asdict().items()}


# --- particles --------------------------------------------------------------------------------------


def _particle_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    return (Part("fog in front of them", *_needs_integrate(scene, settings)),
            Part("lights", *_some(scene.all_lights, _count(len(scene.all_lights), "light"), "the scene has none")))


def _run_particles(job: Job, results: Results) -> dict[str, Field]:
    return transparency_stage.drawn_layers(job, results, _fog_at(job, results))


def _fog_at(job: Job, results: Results) -> FogAt:
    """The fog in front of points that pixels show; none where the scene has none."""
    how = job.settings
    if not (_needs_integrate(job.scene, how)[0] or job.full):
        return lambda rows, columns, depth: (_constant(job, "cx", BLACK), _constant(job, "x", 1.0))
    integrated = Integrated(*(results[name] for name in _INTEGRATED))
    return apply.fog_lookup(integrated, how.grid, job.image_shape, **_lookup_options(job))


def _lookup_options(job: Job) -> dict[str, Any]:
    """How the fog is looked up, and where this frame samples its pixels."""
    how = job.settings
    return {"lookup": how.lookup, "near_surface": how.near_surface, "options": how.fog_lookup,
            "inverse_tone_map": how.inverse_tone_map, "frame": job.frame, "shift": job.pixel_shift,
            "threads": job.threads}


# --- apply ------------------------------------------------------------------------------------------


def _needs_fog(scene: Scene, settings: Settings) -> Need:
    if settings.surface_term == "inside":
        return True, "the surface's light is inside the integral (D5)"
    return _needs_integrate(scene, settings)


def _apply_parts(scene: Scene, settings: Settings) -> tuple[Part, ...]:
    fog, _ = _needs_fog(scene, settings)
    how = settings.fog_lookup
    bias = apply.lookup_bias(how, settings.lookup)
    words = how.method + (f", {bias:g} slice{'s' * (bias != 1)} nearer" if bias else "")
    return (Part("fog lookup", fog, f"at each pixel's depth, {words}" if fog else "the scene has no fog to look up"),
            Part("long range", *long_range_stage.needs_long_range(scene, settings)),
            Part("surface", *_needs_surface(scene, settings)),
            Part("particles", *transparency_stage.needs_layers(scene, settings)))


def _under_particles(job: Job, image: Field, results: Results) -> Field:
    """The image with particles and transparent surfaces laid over it."""
    if not (transparency_stage.needs_layers(job.scene, job.settings)[0] or job.full):
        return image
    return apply.composite(image, results["particles/radiance"], results["particles/transmittance"])


def _run_apply(job: Job, results: Results) -> dict[str, Field]:
    radiance = results["surface/radiance"]
    if job.exposure != 1.0:
        radiance = radiance * job.dtype.type(job.exposure)
    if not (_needs_fog(job.scene, job.settings)[0] or job.full):
        return {"apply/fog_radiance": _constant(job, "cyx", BLACK),
                "apply/fog_transmittance": _constant(job, "yx", 1.0), FINAL: _under_particles(job, radiance, results)}
    integrated = Integrated(*(results[name] for name in _INTEGRATED))
    camera = job.scene.camera
    depth = results["surface/depth"]
    if depth.size == 1:
        depth = np.broadcast_to(depth, (camera.height, camera.width))
    fog, transmittance = long_range_stage.behind(job, results, *_looked_up(job, integrated, depth))
    surface_share = transmittance
    if job.settings.surface_term == "inside":
        surface_share, _ = _looked_up(job, _path(job, temporal_stage.fog_fields(results)[1]), depth)
    return {"apply/fog_radiance": fog, "apply/fog_transmittance": transmittance,
            FINAL: _under_particles(job, apply.composite(radiance, fog, surface_share), results)}


def _looked_up(job: Job, integrated: Integrated, depth: Field) -> tuple[Field, Field]:
    return apply.lookup_fog(integrated, job.settings.grid, depth, **_lookup_options(job))


def _path(job: Job, extinction: Field) -> Integrated:
    """∫T dt along each ray [m], as the radiance that a source of 1 gives (D5)."""
    step, length = grid.step_lengths(job.centres)
    source = np.ones((3, 1, 1, 1), job.dtype)
    return integrate.integrate(source, extinction, step, length, near=job.settings.grid.near,
                               integrate_from=job.settings.integrate_from, threads=job.threads)


# --- the table --------------------------------------------------------------------------------------

_MEDIA = ("media/scattering", "media/extinction", "media/emission", "media/phase_anisotropy",
          "media/lobe_scattering", "media/lobe_anisotropy")
_LIGHTS, _LOCAL = (tuple(f"culling/{kind}_{name}" for name in culling.Culled._fields) for kind in ("light", "medium"))
_SURFACE = ("surface/depth", "surface/normal", "surface/albedo", "surface/radiance")
_SHADOW = tuple(name for names in shadow_stage.NAMES.values() for name in names)
_FOM = (*fom_stage.LAMPS, *fom_stage.SUNS)
_LIGHT = ("lighting/in_scattering", "lighting/phase_ratio")
_INTEGRATED = tuple(f"integrate/{name}" for name in Integrated._fields)


def _always(scene: Scene, settings: Settings) -> Need:
    return True, "asked for"


STAGES: tuple[Stage, ...] = (
    Stage("grid", "froxels: slices of view depth", (), ("grid/slice_depth",),
          _always, lambda job: {}, _run_grid),
    Stage("shadow", "maps of what surfaces hide from each light", (), _SHADOW, shadow_stage.needs_maps,
          lambda job: shadow_stage.empty_maps(job.settings, job.dtype), _run_shadow, _shadow_parts,
          lambda job: shadow_stage.map_keys(job.scene, job.settings, job.assets)),
    Stage("fom", "opacity maps: what media and particles let through of each light", (), _FOM,
          fom_plan.needs_maps, lambda job: fom_stage.empty_maps(job.settings, job.dtype), _run_fom, fom_plan.map_parts,
          lambda job: fom_stage.map_keys(job.scene, job.settings, job.assets)),
    Stage("surface", "the nearest opaque surface and its Lambert shading", (*_SHADOW, *_FOM), _SURFACE,
          _needs_surface, _neutral_surface, _run_surface),
    Stage("long_range", "light and transmittance behind the froxels, at half the image's resolution",
          ("surface/depth", *_SHADOW, *_FOM), long_range_stage.FIELDS, long_range_stage.needs_long_range,
          long_range_stage.nothing_marched, long_range_stage.long_range_fields, long_range_stage.long_range_parts),
    Stage("culling", "which lights and local media can reach which tiles and depths", (), (*_LIGHTS, *_LOCAL),
          _needs_culling, _neutral_culling, _run_culling, _culling_parts),
    Stage("media", "the V-Buffer: material of the media at each froxel", _LOCAL, (*_MEDIA, "media/albedo"),
          _needs_media, _neutral_media, fog_stages.voxel_fields, _media_parts),
    Stage("material", "the V-Buffer and a sun's visibility filtered over frames", (*_MEDIA, *_SHADOW, *_FOM),
          material_stage.FIELDS, _needs_material, material_stage.nothing_filtered, material_stage.filtered_material,
          material_stage.material_parts),
    Stage("lighting", "light scattered towards the camera at each froxel",
          (*_MEDIA, *material_stage.FIELDS[:-1], *_SHADOW, *_FOM, *_LIGHTS, *_LOCAL), _LIGHT,
          _needs_lighting, _neutral_lighting, fog_stages.scattered_fields, _lighting_parts),
    Stage("merged", "media and lighting in one, slab by slab", (*_LOCAL, *_SHADOW, *_FOM, *_LIGHTS),
          (*_LIGHT, "media/extinction"), _needs_merged, lambda job: {}, fog_stages.merged_fields, _merged_parts),
    Stage("temporal", "froxels filtered over frames, holes of the checkerboard filled",
          (*_LIGHT, "media/extinction", "material/extinction"), temporal_stage.FIELDS,
          _needs_temporal, temporal_stage.nothing_filtered, temporal_stage.filtered_fields,
          temporal_stage.temporal_parts),
    Stage("integrate", "radiance and transmittance from the camera to each slice",
          ("lighting/in_scattering", "media/extinction", "material/extinction", *temporal_stage.FIELDS[:2]),
          _INTEGRATED, _needs_integrate, _neutral_integrate, _run_integrate),
    Stage("particles", "billboards and transparent surfaces, lit and fogged at their own depth, from back to front",
          (*_SHADOW, *_FOM, "surface/depth", *_INTEGRATED), transparency_stage.FIELDS, transparency_stage.needs_layers,
          transparency_stage.nothing_drawn, _run_particles, _particle_parts),
    Stage("apply", "surface, under the long range and the fog at each pixel's depth, under particles",
          (*_SURFACE, *_INTEGRATED, "media/extinction", "material/extinction", "lighting/in_scattering",
           *temporal_stage.FIELDS[:2],
           *long_range_stage.FIELDS, *transparency_stage.FIELDS),
          ("apply/fog_radiance", "apply/fog_transmittance", FINAL), _always, lambda job: {}, _run_apply,
          _apply_parts),
    Stage("taa", "the image averaged over frames", (FINAL, "surface/depth"), (AVERAGED,), taa_stage.needs_average,
          taa_stage.no_average, taa_stage.averaged_image),
)
