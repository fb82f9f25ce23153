"""Other people's delay-and-sum, and NumPy's, each as a piece of work that returns an image of plain sums.

Every peer gets the signals in the layout and precision that it likes and its tables made beforehand; only the sum is
timed. All are one-way: PyMUST by its passive mode, the others by a transmit delay of zero.
"""

from __future__ import annotations

import ctypes
import importlib.util
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.timing import Work
from markerseek.signals.presets import ProbePreset


def pymust_matrix(
    plain: np.ndarray, preset: ProbePreset, *, lateral_m: np.ndarray, depth_m: np.ndarray, single: bool
) -> Work:
    """PyMUST's sparse matrix, as it comes or as float32 in rows (CSR).

    Parameters
    ----------
    plain
        Signals, shape (samples, elements), float32.
    preset
        The probe.
    lateral_m, depth_m
        Pixels.
    single
        Whether the matrix is converted.
    """
    import pymust

    param = pymust.utils.Param()
    param.fs = preset.sampling_hz
    param.pitch = preset.array.pitch_m
    param.c = preset.sound_speed_m_s
    param.fc = (preset.low_hz + preset.high_hz) / 2
    param.fnumber = preset.f_number
    param.passive = True
    param.radius = np.inf
    param.Nelements = preset.array.elements
    x, z = np.meshgrid(lateral_m, depth_m)
    matrix = pymust.dasmtx(np.array(plain.shape), x, z, np.zeros((1, preset.array.elements)), param)
    signals = plain.flatten(order="F").astype(np.float64)
    if single:
        matrix = matrix.tocsr().astype(np.float32)
        signals = signals.astype(np.float32)
    return lambda: (matrix @ signals).reshape(x.shape, order="F")


def numpy_gather(plain: np.ndarray, preset: ProbePreset, *, lateral_m: np.ndarray, depth_m: np.ndarray) -> Work:
    """NumPy, element by element, with the delays worked out for each frame; full aperture."""
    channels = np.ascontiguousarray(plain.T)
    per_metre = np.float32(preset.sampling_hz / preset.sound_speed_m_s)
    depth = (depth_m**2).astype(np.float32)[:, None]

    def work() -> np.ndarray:
        image = np.zeros((len(depth_m), len(lateral_m)), np.float32)
        for channel, x in zip(channels, preset.array.lateral_m, strict=True):
            place = np.sqrt(depth + ((lateral_m - x) ** 2).astype(np.float32)) * per_metre
            first = place.astype(np.int32)
            place -= first
            early = channel[first]
            image += early + place * (channel[first + 1] - early)
        return image

    return work


def fast_das(plain: np.ndarray, preset: ProbePreset, *, lateral_m: np.ndarray, depth_m: np.ndarray) -> Work:
    """The C++ library of fast-das, with its delays given; full aperture, double precision.

    It is called past its Python wrapper, which does not import beside a recent setuptools. It sums complex signals:
    their imaginary part is zero here, and the second sum is part of its time. It reads half a sample early, which the
    delay of transmission makes good, and interpolates by a curve, not by a line.
    """
    spec = importlib.util.find_spec("fastDAS")
    if spec is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError("fastDAS")
    library = ctypes.CDLL(str(Path(spec.submodule_search_locations[0]) / "bin" / "libdas.so"))
    array = np.ctypeslib.ndpointer(dtype=np.float64, ndim=3, flags="C_CONTIGUOUS")
    library.delay_and_sum.argtypes = [array] * 6 + [ctypes.c_int] * 5
    library.delay_and_sum.restype = None
    shape = (1, len(depth_m), len(lateral_m))
    real = np.ascontiguousarray(plain.T, np.float64)[None]
    imaginary = np.zeros_like(real)
    offset = preset.array.lateral_m[:, None, None] - lateral_m
    receive = np.hypot(offset, depth_m[:, None]) * (preset.sampling_hz / preset.sound_speed_m_s)
    transmit = np.full(shape, 0.5)

    def work() -> np.ndarray:
        image = np.zeros(shape)
        other = np.zeros(shape)
        library.delay_and_sum(
            image, other, real, imaginary, transmit, receive, 1, *real.shape[1:], len(depth_m), len(lateral_m)
        )
        return image[0]

    return work


def vbeam_jax(plain: np.ndarray, preset: ProbePreset, *, lateral_m: np.ndarray, depth_m: np.ndarray) -> Work:
    """The beamformer of vbeam on JAX, compiled for the processor; full aperture, single precision."""
    import jax
    from spekk import Spec
    from vbeam.apodization import NoApodization
    from vbeam.beamformers.building_blocks import sum_over_dimensions, unflatten_points, vectorize_over_datacube
    from vbeam.core import ElementGeometry, ReflectedWavefront, TransmittedWavefront, WaveData, signal_for_point
    from vbeam.data_importers import SignalForPointSetup
    from vbeam.fastmath import backend_manager
    from vbeam.fastmath.traceable import traceable_dataclass
    from vbeam.interpolation import FastInterpLinspace
    from vbeam.scan import linear_scan
    from vbeam.util.transformations import compose

    backend_manager.active_backend = "jax"

    @traceable_dataclass()
    class LightIsEverywhere(TransmittedWavefront):
        """No way to the pixel: the light is there at once."""

        def __call__(self, sender: object, point_position: object, wave_data: object) -> float:  # noqa: ARG002
            return 0.0

    number = jax.numpy.float32
    elements = np.zeros((preset.array.elements, 3), np.float32)
    elements[:, 0] = preset.array.lateral_m
    setup = SignalForPointSetup(
        sender=ElementGeometry(jax.numpy.zeros(3, number), 0.0, 0.0),
        point_position=None,
        receiver=ElementGeometry(jax.numpy.asarray(elements)),
        signal=jax.numpy.asarray(np.ascontiguousarray(plain.T), number),
        transmitted_wavefront=LightIsEverywhere(),
        reflected_wavefront=ReflectedWavefront(),
        speed_of_sound=number(preset.sound_speed_m_s),
        wave_data=WaveData(t0=number(0.0)),
        interpolate=FastInterpLinspace(number(0.0), number(1 / preset.sampling_hz), plain.shape[0]),
        modulation_frequency=None,
        apodization=NoApodization(),
        scan=linear_scan(jax.numpy.asarray(lateral_m, number), jax.numpy.asarray(depth_m, number)),
        spec=Spec({"signal": ["receivers", "signal_time"], "receiver": ["receivers"], "point_position": ["points"]}),
    )
    # As `vbeam.beamformers.get_das_beamformer` puts it together, for real signals, which need no turn of phase; and
    # without its logarithm and its conversion of the grid.
    beamform = compose(
        partial(signal_for_point, modulation_frequency=None),
        vectorize_over_datacube(setup),
        sum_over_dimensions(setup),
        unflatten_points(setup),
    ).build(setup.spec)
    compiled = jax.jit(lambda signal: beamform(**{**setup.data, "signal": signal}))
    signal = setup.signal
    return lambda: np.asarray(compiled(signal).block_until_ready()).T
