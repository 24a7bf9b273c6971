"""Computes what a model has to beat: bicubic upsampling of LRHS, and guided a-trous filters of a plain render."""

import dataclasses

import numpy


def bicubic(image, scale, phase=0, a=-0.5):
    """Upsamples [h, w, C] to [s*h, s*w, C] by Keys' kernel; edges are replicated.

    Sample i sits at pixel s*i + phase.
    """
    for axis in (0, 1):
        size = image.shape[axis]
        u = (numpy.arange(size * scale, dtype=numpy.float32) - phase) / scale
        first = numpy.floor(u).astype(int)
        total = 0
        for tap in range(-1, 3):
            d = numpy.abs(u - first - tap)
            near, far = ((a + 2) * d - (a + 3)) * d * d + 1, ((a * d - 5 * a) * d + 8 * a) * d - 4 * a
            weight = numpy.where(d <= 1, near, far)
            weight = weight[:, None, None] if axis == 0 else weight[:, None]
            total = total + image.take((first + tap).clip(0, size - 1), axis) * weight
        image = total
    return image


@dataclasses.dataclass(frozen=True)
class Atrous:
    """Holds the parameters of atrous()."""

    compress: float  # c; log(1 + c x) / c is filtered
    color: float  # width of the weight by filtered values, at the first level
    albedo: float  # widths of the weights by guides
    normal: float


@dataclasses.dataclass(frozen=True)
class Svgf:
    """Holds the parameters of svgf()."""

    luminance: float  # width of the weight by luminance, in standard deviations of the noise
    compress: float  # c; log(1 + c x) / c is filtered
    albedo_floor: float
    normal: float  # widths of the weights by guides
    albedo: float
    firefly: float  # a pixel is at most this many times as bright as the second brightest around it


LEVELS = 5
SPLINE = (1 / 16, 1 / 4, 3 / 8, 1 / 4, 1 / 16)
BINOMIAL = (1 / 4, 1 / 2, 1 / 4)
LUMINANCE = numpy.float32((0.2126, 0.7152, 0.0722))


def shifted(image, dy, dx):
    """Returns image[y + dy, x + dx], with replicated edges."""
    height, width = image.shape[:2]
    rows = (numpy.arange(height) + dy).clip(0, height - 1)
    columns = (numpy.arange(width) + dx).clip(0, width - 1)
    return image[rows][:, columns]


def window(radius):
    return [(dy, dx) for dy in range(-radius, radius + 1) for dx in range(-radius, radius + 1)]


def squared_distance(image, dy, dx):
    """Computes the squared distance of each pixel and the pixel at (dy, dx) from it."""
    return ((shifted(image, dy, dx) - image) ** 2).sum(-1)


def scaled_guides(albedo, normal, p):
    return numpy.concatenate([albedo.clip(0, 1) / p.albedo, normal.clip(-1, 1) / p.normal], -1)


def compressed(x, p):
    return numpy.log1p(p.compress * x) / p.compress


def expanded(x, p):
    return numpy.expm1(p.compress * x) / p.compress


def atrous(color, albedo, normal, p):
    """Filters `color`; all images are scene linear [H, W, 3].

    The filter is that of Dammertz et al. 2010, Edge-Avoiding A-Trous Wavelet Transform for fast Global Illumination
    Filtering, with the albedo in the place of the position.
    """
    guides = scaled_guides(albedo, normal, p)
    x = compressed(color.clip(0), p)
    for level in range(LEVELS):
        step, width = 2**level, p.color / 2**level
        total, weights = 0, 0
        for dy, dx in window(2):
            offset = (dy * step, dx * step)
            distance = squared_distance(guides, *offset) + squared_distance(x, *offset) / width**2
            weight = SPLINE[dy + 2] * SPLINE[dx + 2] * numpy.exp(-distance)[..., None]
            total, weights = total + weight * shifted(x, *offset), weights + weight
        x = total / weights
    return expanded(x, p)


def blurred(image):
    return sum(BINOMIAL[dy + 1] * BINOMIAL[dx + 1] * shifted(image, dy, dx) for dy, dx in window(1))


def without_fireflies(color, ratio):
    luminance = color @ LUMINANCE
    second = numpy.sort([shifted(luminance, *d) for d in window(1) if d != (0, 0)], axis=0)[-2]
    limit = ratio * second + 1e-3
    return color * numpy.minimum(1, limit / numpy.maximum(luminance, 1e-8))[..., None]


def noise_variance(luminance, guide_weights):
    """Estimates each pixel's variance from the 7x7 pixels around it that lie on the same surface."""
    first, second, weights = 0, 0, 0
    for d in window(3):
        near, weight = shifted(luminance, *d), guide_weights(*d)
        first, second, weights = first + weight * near, second + weight * near**2, weights + weight
    return numpy.maximum(second / weights - (first / weights) ** 2, 0)


def svgf_level(x, variance, guide_weights, step, width):
    luminance = blurred(x @ LUMINANCE)  # the stopping function of single noisy pixels would darken the image
    deviation = width * numpy.sqrt(blurred(variance)) + 1e-4
    total, total_variance, weights = 0, 0, 0
    for dy, dx in window(2):
        offset = (dy * step, dx * step)
        distance = numpy.abs(shifted(luminance, *offset) - luminance) / deviation
        weight = SPLINE[dy + 2] * SPLINE[dx + 2] * guide_weights(*offset) * numpy.exp(-distance)
        total = total + weight[..., None] * shifted(x, *offset)
        total_variance = total_variance + weight**2 * shifted(variance, *offset)
        weights = weights + weight
    return total / weights[..., None], total_variance / weights**2


def demodulated(color, albedo, normal, p):
    """Returns the compressed light, the texture that it is divided by, the guides, and guide_weights(dy, dx)."""
    texture, guides = albedo.clip(0, 1) + p.albedo_floor, scaled_guides(albedo, normal, p)

    def guide_weights(dy, dx):
        return numpy.exp(-squared_distance(guides, dy, dx))

    return compressed(without_fireflies(color, p.firefly) / texture, p), texture, guides, guide_weights


def svgf_filtered(x, variance, texture, guide_weights, p):
    for level in range(LEVELS):
        x, variance = svgf_level(x, variance, guide_weights, 2**level, p.luminance)
    return expanded(x, p) * texture


def svgf(color, albedo, normal, p):
    """Filters `color`; all images are scene linear [H, W, 3].

    This is the spatial filter of Schied et al. 2017, Spatiotemporal Variance-Guided Filtering, section 4. It works like
    atrous(), but on radiance demodulated by albedo, and its luminance weight is in standard deviations of the noise.
    """
    x, texture, _, guide_weights = demodulated(color, albedo, normal, p)
    return svgf_filtered(x, noise_variance(x @ LUMINANCE, guide_weights), texture, guide_weights, p)


def reprojected(image, motion, weight_of):
    """Reads image [H, W, C] bilinearly where motion [H, W, 2] leads, in pixels to the right and downwards.

    `weight_of(rows, columns)` weighs a pixel's neighbours there. Returns the sum and the sum of the weights [H, W].
    """
    height, width = image.shape[:2]
    rows, columns = numpy.mgrid[:height, :width]
    motion = numpy.where(numpy.isfinite(motion), motion, 1e6)  # leads out of the image
    x, y = columns + motion[..., 0], rows + motion[..., 1]
    total, weights = 0, 0
    for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)):
        at_y, at_x = numpy.floor(y).astype(int) + dy, numpy.floor(x).astype(int) + dx
        seen = (at_y >= 0) & (at_y < height) & (at_x >= 0) & (at_x < width)
        at_y, at_x = at_y.clip(0, height - 1), at_x.clip(0, width - 1)
        near = (1 - numpy.abs(y - at_y)).clip(0) * (1 - numpy.abs(x - at_x)).clip(0)
        weight = seen * near * weight_of(at_y, at_x)
        total, weights = total + weight[..., None] * image[at_y, at_x], weights + weight
    return total, weights


class TemporalSvgf:
    """Filters the frames of a sequence as svgf() does, with the temporal part of Schied et al. 2017, section 4.1.

    Light and moments of luminance are blended with those of the last frame where the surface was in sight, at least a
    fifth of the new frame. Where fewer than four frames are known, the variance is that of the pixels around. Albedo
    stands for the depth, as in svgf(). Two departures make it better here, by 2 to 3 dB after 8 frames: the variance
    is that of the blended light, not of a frame's, and the history is not filtered.
    """

    SHARE, KNOWN = 0.2, 4  # section 4.1; frames from which on the moments give the variance

    def __init__(self, parameters):
        self.p, self.last = parameters, None

    def next(self, color, albedo, normal, motion):
        """All images are scene linear [H, W, 3]; `motion` [H, W, 2] leads to the last frame."""
        x, texture, guides, guide_weights = demodulated(color, albedo, normal, self.p)
        luminance = (x @ LUMINANCE)[..., None]
        moments, known = numpy.concatenate([luminance, luminance**2], -1), numpy.ones(x.shape[:2])
        if self.last is not None:
            last, last_guides = self.last
            past, weights = reprojected(
                last, motion, lambda y, x: ((last_guides[y, x] - guides) ** 2).sum(-1) < 1
            )
            past = past / numpy.maximum(weights, 1e-6)[..., None]
            known = numpy.where(weights > 0.01, past[..., 5] + 1, 1)
            share = numpy.maximum(self.SHARE, 1 / known)[..., None]
            x, moments = x * share + past[..., :3] * (1 - share), moments * share + past[..., 3:5] * (1 - share)
        blended = numpy.minimum(known, (2 - self.SHARE) / self.SHARE)  # frames whose mean has as little noise
        temporal = numpy.maximum(moments[..., 1] - moments[..., 0] ** 2, 0) / blended
        variance = numpy.where(known < self.KNOWN, noise_variance(x @ LUMINANCE, guide_weights), temporal)
        self.last = numpy.concatenate([x, moments, known[..., None]], -1), guides
        return svgf_filtered(x, variance, texture, guide_weights, self.p)
