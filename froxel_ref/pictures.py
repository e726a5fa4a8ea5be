"""Pictures of a frame: a preview of each array, and the contact sheet of all of them.

How values become colours is told in `froxel_ref.display`: radiance is exposed, tone-mapped and
sRGB-encoded, everything else has its range beside it. A picture whose texels are all alike is a flat
patch with its value.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from froxel_ref import number_panels, panels
from froxel_ref.arrays import Field
from froxel_ref.culling import lights_per_tile
from froxel_ref.display import Bytes, Display, display_for, to_srgb8
from froxel_ref.panels import AMBER, FAINT, INK, PAPER, View, canvas, write
from froxel_ref.quantities import AVERAGED, FINAL, QUANTITIES, Quantity, raster_size, stored_grid

if TYPE_CHECKING:
    from PIL.Image import Image

    from froxel_ref.frame import Frame, Planned

__all__ = [
    "View", "channel_first", "contact_sheet", "final_image", "full_axes", "preview", "to_srgb8", "varying",
]

PAGE, MARGIN, GAP, HEAD, FOOT = 2400, 48, 24, 34, 60
# Of shadow maps, texels shown of a face, faces in a row; and axes of arrays that are read, not looked at.
MAP_TEXELS, MAPS_ACROSS, TABLES = 256, 6, ("m", "mfij", "mfe", "mfa", "n")
SLIM, NARROW = 30, 300  # no picture on top is lower or narrower than this, with its words [px]
COUNTED = {"l": "lobe", "eb": "red: first place, green: last, red above: none; bin"}
HERO = (AVERAGED, FINAL, "surface/radiance", "apply/fog_radiance", "apply/fog_transmittance",
        "surface/depth")


# --- axes -------------------------------------------------------------------------------------------


def full_axes(array: Field, quantity: Quantity) -> str:
    """The array's axes: the quantity's, and a channel in front where its extinction is per colour.

    Parameters
    ----------
    array : array
        A result of `froxel_ref.frame.run_frame`.
    quantity : Quantity
        What it is.

    Returns
    -------
    str
        A letter for each axis, such as ``czyx``.

    Examples
    --------
    >>> from froxel_ref.quantities import QUANTITIES
    >>> full_axes(np.ones((3, 1, 1, 1)), QUANTITIES["media/extinction"])
    'czyx'
    """
    return "c" * (array.ndim - len(quantity.axes)) + quantity.axes


def varying(array: Field, quantity: Quantity) -> str:
    """The axes but channels and lobes along which the array has more than one entry.

    Parameters
    ----------
    array : array
        A result of `froxel_ref.frame.run_frame`.
    quantity : Quantity
        What it is.

    Returns
    -------
    str
        Their letters, in order.

    Examples
    --------
    >>> from froxel_ref.quantities import QUANTITIES
    >>> varying(np.zeros((3, 1, 90, 1)), QUANTITIES["media/scattering"])
    'y'
    """
    return "".join(axis for axis, size in zip(full_axes(array, quantity), array.shape, strict=True)
                   if axis not in "cl" and size > 1)


def channel_first(array: Field, quantity: Quantity) -> Field:
    """The array with a channel axis in front: lobes of a mixture added up, bits of tiles counted, maps side by side.

    Parameters
    ----------
    array : array
        A result of `froxel_ref.frame.run_frame`.
    quantity : Quantity
        What it is.

    Returns
    -------
    array, shape (C, ...)
        C is 1 or 3; 2 for first and last place.

    Examples
    --------
    >>> from froxel_ref.quantities import QUANTITIES
    >>> channel_first(np.zeros((4, 1, 1)), QUANTITIES["integrate/transmittance"]).shape
    (1, 4, 1, 1)
    """
    axes = full_axes(array, quantity)
    if axes == "mfpq":
        return _mosaic(array)[None]
    if axes in ("cpq", "mfepq", "mfcpq"):
        return _mosaic(_rows_of_maps(array, axes))[None]
    if axes == "wvu":
        return lights_per_tile(array)[None]
    if axes in ("eb", "n"):
        return np.asarray(array, np.float64).reshape(-1, array.shape[-1])
    if axes.startswith("l") and len(axes) > 1:
        with np.errstate(over="ignore", invalid="ignore"):
            array, axes = array.sum(axis=0), axes[1:]
    return array if axes.startswith("c") else array[None]


def _rows_of_maps(array: Field, axes: str) -> Field:
    """Maps of coefficients or ranges as (rows, maps in a row, texels): of an atlas the a_k above the b_k."""
    if axes == "mfepq":
        return array.reshape(len(array), -1, *array.shape[-2:])
    if axes == "cpq":
        return array.reshape(-1, 2 - len(array) % 2, *array.shape[-2:]).swapaxes(0, 1)
    return array.reshape(-1, *array.shape[-3:])


def _mosaic(maps: Field) -> Field:
    """Shadow maps as one image: a light's faces side by side, lights in rows, as many beside each other as fit."""
    lights, faces, rows, _ = maps.shape
    thin = max(1, rows // MAP_TEXELS)
    small = maps[..., thin // 2::thin, thin // 2::thin]
    beside = max(1, min(lights, MAPS_ACROSS // faces))
    count = -(-lights // beside)
    filled = np.full((count * beside, *small.shape[1:]), np.inf, maps.dtype)
    filled[:lights] = small
    gap = max(1, small.shape[2] // 32)
    filled = np.pad(filled, ((0, 0), (0, 0), (gap, gap), (gap, gap)), constant_values=np.inf)
    parts = filled.reshape(count, beside, faces, *filled.shape[2:])
    image: Field = parts.transpose(0, 3, 1, 2, 4).reshape(count * filled.shape[2], -1)
    return image


# --- one array --------------------------------------------------------------------------------------


def preview(array: Field, quantity: Quantity, *, name: str, view: View) -> Bytes:
    """One array as a picture with its name, unit, range and the axes it varies on.

    Parameters
    ----------
    array : array
        A result of `froxel_ref.frame.run_frame`, channel first, with length-1 axes where it is constant.
    quantity : Quantity
        What it is.
    name : str
        ``stage/quantity``; decides how it is shown (`froxel_ref.display`).
    view : View
        Camera, grid and exposure of the frame.

    Returns
    -------
    array of uint8, shape (height, width, 3)
        Images whole; volumes as up to 16 slices, with their depths, and a plan from above, to scale.
    """
    values = channel_first(array, quantity)
    display = display_for(name, values, view.exposure)
    body = _body(name, values, quantity, display, view, slices=(4, 4), target=240, box=(1280, 960),
                 width=PAGE)
    framed = _framed(body, name, array, quantity, display, min_width=560)
    page = canvas(framed.width + 2 * GAP, framed.height + 2 * GAP)
    page.paste(framed, (GAP, GAP))
    return np.asarray(page)


def final_image(radiance: Field, view: View) -> Bytes:
    """The final radiance as an 8-bit sRGB image of the camera's size.

    Parameters
    ----------
    radiance : array, broadcastable to (3, height, width) [W m⁻² sr⁻¹]
    view : View

    Returns
    -------
    array of uint8, shape (height, width, 3)
    """
    whole = np.broadcast_to(radiance, (3, view.camera.height, view.camera.width))
    return to_srgb8(whole, view.exposure)


def _body(name: str, values: Field, quantity: Quantity, display: Display, view: View, *,
          slices: tuple[int, int], target: int, box: tuple[int, int], width: int) -> Image:
    """The picture itself, by which of z, y, x the values vary on."""
    if quantity.axes in TABLES:
        return number_panels.table_panel(values[0], width)
    if _equal(values):
        return panels.swatch(values, display, 300, 84)
    if _along_one(values):
        return number_panels.curve_panel(values, min(560, box[0]), 220, COUNTED.get(quantity.axes, "slice"))
    if quantity.axes == "wvu":
        return panels.scaled(display.paint(values), box[0], box[1])
    if values.ndim == 3:
        return panels.image_panel(values, display, raster_size(quantity, view.camera, view.grid), box[0], box[1])
    strip = panels.slices_panel(values, display, view, slices, at_boundary=name.startswith("integrate/"),
                                target=target)
    room = max(280, width - strip.width - GAP)
    return _beside([strip, panels.plan_panel(values, display, view, room, max(120, min(strip.height, 560)))])


def _equal(values: Field) -> bool:
    """Whether every texel has the same colour, and none is NaN."""
    first = values.reshape(values.shape[0], *(1,) * (values.ndim - 1), -1)[..., 0]
    return bool((values == first).all())


def _along_one(values: Field) -> bool:
    """Whether the values are a line: they vary along z alone, or have no other axis."""
    return values.ndim == 2 or (values.ndim == 4 and values[0].size == values.shape[1] > 1)


def _framed(body: Image, name: str, array: Field, quantity: Quantity, display: Display, *,
            min_width: int = 0) -> Image:
    """A picture with its name and unit above, its range and axes below."""
    width = max(body.width, min_width)
    if quantity.axes.startswith("m") or quantity.axes in TABLES:
        return _framed_maps(body, name, array, quantity, display, width)
    axes, unit = varying(array, quantity), f"  [{quantity.unit}]" if quantity.unit != "1" else ""
    same = _equal(channel_first(array, quantity))
    carried = "the same everywhere" if same else f"varies along {', '.join(axes) or 'its lobes'}"
    if quantity.axes == "cpq":
        carried = f"a_0, a_1, … in a row, b_0, b_1, … below; {array.shape[1]} x {array.shape[2]} texels"
    if quantity.axes == "eb":
        carried = "the places, in the order by depth, between which the lights or media of a bin lie"
    if quantity.axes == "wvu":
        carried = f"bits set, of {array.shape[1]} rows of {array.shape[2]} tiles"
    picture = canvas(width, body.height + HEAD + FOOT)
    write(picture, (0, 0), f"{name}{unit}", 22, INK, width)
    picture.paste(body, (0, HEAD))
    foot = HEAD + body.height + 4
    if not same:
        plain = _along_one(channel_first(array, quantity))
        picture.paste(number_panels.legend(display, width, plain=plain), (0, foot))
        foot += 27
    write(picture, (0, foot), carried, 18, FAINT, width)
    return picture


def _framed_maps(body: Image, name: str, array: Field, quantity: Quantity, display: Display, width: int) -> Image:
    """Shadow maps, or numbers that go with them, with their name above and what they are below."""
    table = quantity.axes in TABLES
    unit = "" if quantity.unit == "1" else f"  [{quantity.unit}]"
    picture = canvas(width, body.height + HEAD + FOOT)
    write(picture, (0, 0), f"{name}{unit}", 20, INK, width)
    picture.paste(body, (0, HEAD))
    foot = HEAD + body.height + 4
    if not table:
        picture.paste(number_panels.legend(display, width), (0, foot))
        foot += 23
    size = " x ".join(str(n) for n in array.shape[2:])
    faces = f" with {array.shape[1]} face{'s' * (array.shape[1] > 1)} of {size}" if array.ndim > 1 else ""
    if quantity.axes in ("mfepq", "mfcpq"):
        size = " x ".join(str(n) for n in array.shape[3:])
        faces = f" with {array.shape[1]} cascades of {array.shape[2]} x {size}"
    words = f"{array.shape[0]} light{'s' * (len(array) > 1)}{faces}"
    if quantity.axes == "n":
        words = f"{len(array)} in their order by depth"
    elif quantity.axes == "mfcpq":
        words += ", a cascade's in a row: a_0, b_0, a_1, b_1, …"
    elif quantity.axes == "mfepq":
        words += ", near and far of each side by side"
    elif not table:
        words += ", a light's side by side; grey: nothing is hit"
    write(picture, (0, foot), words, 16, FAINT, width)
    return picture


def _beside(images: list[Image], gap: int = GAP) -> Image:
    row = canvas(sum(i.width for i in images) + gap * (len(images) - 1), max(i.height for i in images))
    x = 0
    for image in images:
        row.paste(image, (x, 0))
        x += image.width + gap
    return row


def _below(images: list[Image], gap: int = GAP) -> Image:
    column = canvas(max(i.width for i in images), sum(i.height for i in images) + gap * (len(images) - 1))
    y = 0
    for image in images:
        column.paste(image, (0, y))
        y += image.height + gap
    return column


def _flow(images: list[Image], width: int) -> Image:
    """Pictures in rows, as many in each as fit."""
    rows: list[list[Image]] = []
    for image in images:
        if rows and sum(i.width + GAP for i in rows[-1]) + image.width <= width:
            rows[-1].append(image)
        else:
            rows.append([image])
    return _below([_beside(row) for row in rows])


# --- the sheet --------------------------------------------------------------------------------------


def contact_sheet(frame: Frame) -> Bytes:
    """All results of a frame on one page.

    Parameters
    ----------
    frame : Frame
        With every result kept (`run_frame` without ``outputs``); missing ones are left out of the page.

    Returns
    -------
    array of uint8, shape (height, 2400, 3)
        The final image with its parts on top, then each stage with slices, ranges, units and axes;
        stages and parts that were left out stand with their reasons.
    """
    view = View(frame.scene.camera, frame.settings.grid, frame.display_exposure)
    width = PAGE - 2 * MARGIN
    parts = [_title(frame, width), _hero(frame, view, width)]
    parts += [_stage(frame, planned, view, width) for planned in frame.plan.stages]
    body = _below(parts, 34)
    page = canvas(PAGE, body.height + 2 * MARGIN)
    page.paste(body, (MARGIN, MARGIN))
    return np.asarray(page)


def _title(frame: Frame, width: int) -> Image:
    scene, settings, grid = frame.scene, frame.settings, frame.settings.grid
    image = canvas(width, 122)
    write(image, (0, 0), scene.name or "unnamed scene", 48, INK, width)
    write(image, (0, 60), scene.description, 22, FAINT, width)
    facts = (f"{grid.width} x {grid.height} x {grid.depth} froxels",
             f"{grid.distribution} slices, {grid.near:g} to {grid.far:g} m",
             f"{scene.camera.width} x {scene.camera.height} pixels", f"exposure {frame.display_exposure:g}",
             f"fidelity {settings.fidelity}", f"integrator {settings.integrator}",
             f"phase function {settings.phase_function}", settings.precision)
    write(image, (0, 94), "  ·  ".join(facts), 19, FAINT, width)
    return image


def _hero_names(frame: Frame) -> list[str]:
    """The final image, averaged if there is an average, and what it is made of."""
    found = [name for name in HERO if name in frame.results and frame.results[name].size]
    return [name for name in found if name != FINAL or AVERAGED not in found]


def _hero(frame: Frame, view: View, width: int) -> Image:
    """The final image large; beside it, as tall together, what it is made of."""
    shown = _hero_names(frame)
    if not shown:
        return canvas(width, 1)
    aspect = view.camera.width / view.camera.height
    tall = min(1100, int((width - 2 * GAP) / aspect + GAP + HEAD + FOOT) // 2)
    short = (tall - GAP - HEAD - FOOT) // 2
    if short < SLIM:  # too wide an image to stand beside another
        return _below([_image_cell(frame, name, view, width, 4 * SLIM) for name in shown])
    cells = [_image_cell(frame, name, view, width, tall if name == shown[0] else short) for name in shown]
    pairs = [_below(cells[i:i + 2]) for i in range(1, len(cells), 2)]
    return _beside([cells[0], *pairs])


def _image_cell(frame: Frame, name: str, view: View, width: int, height: int) -> Image:
    array, quantity = frame.results[name], QUANTITIES[name]
    values = channel_first(array, quantity)
    display = display_for(name, values, view.exposure)
    if _equal(values):
        across = min(width, max(NARROW, round(height * view.camera.width / view.camera.height)))
        panel = panels.swatch(values, display, across, height)
    else:
        panel = panels.image_panel(values, display, raster_size(quantity, view.camera, view.grid), width, height,
                                   exact=False)
    return _framed(panel, name, array, quantity, display, min_width=NARROW)


def _stage(frame: Frame, planned: Planned, view: View, width: int) -> Image:
    """One stage: a heading, what it left out, and its arrays."""
    heading = canvas(width, 48, PAPER)
    heading.paste(canvas(width, 1, FAINT), (0, 0))
    write(heading, (0, 12), planned.name, 28, INK)
    if planned.runs:
        write(heading, (160, 19), f"runs: {planned.why}  ·  {planned.stage.about}", 19, FAINT, width - 160)
    else:
        below = any(frame.results[name].size for name in frame.plan.written_by(planned) if name in frame.results)
        words = f"left out: {planned.why}" + "  ·  its neutral values stand below" * below
        write(heading, (160, 19), words, 19, AMBER, width - 160)
    skipped = [f"{part.name} ({part.why})" for part in planned.parts if not part.runs]
    hero = _hero_names(frame)
    above = [name for name in planned.stage.writes if name in hero]
    notes = (["left out within it: " + ",  ".join(skipped)] if skipped and planned.runs else []) + (
        ["on top of the page: " + ", ".join(above)] if above else [])
    images = [heading]
    for note in notes:
        line = canvas(width, 26)
        write(line, (0, 0), note, 18, FAINT, width)
        images.append(line)
    names = [name for name in frame.plan.written_by(planned) if name in frame.results and name not in hero]
    cells = [_cell(frame.results[name], name, view._replace(grid=stored_grid(name, frame.settings)), width)
             for name in names if frame.results[name].size]
    rows = [cell for cell in cells if cell.width >= width // 2]
    small = [cell for cell in cells if cell.width < width // 2]
    return _below([*images, *rows, *([_flow(small, width)] if small else [])], 16)


def _cell(array: Field, name: str, view: View, width: int) -> Image:
    quantity = QUANTITIES[name]
    values = channel_first(array, quantity)
    display = display_for(name, values, view.exposure)
    box = (640, 360) if quantity.raster == "image" else (280, 158)
    body = _body(name, values, quantity, display, view, slices=(2, 8), target=180, box=box, width=width)
    return _framed(body, name, array, quantity, display, min_width=400)
