"""What a model has to beat: bicubic upsampling of LRHS, and a guided a-trous filter of a plain render."""

import dataclasses

import numpy


def bicubic(image, scale, a=-0.5):
    """[h, w, C] -> [s*h, s*w, C]; Keys' kernel; LR sample i sits at HR coordinate s*i; edges replicated."""
    for axis in (0, 1):
        size = image.shape[axis]
        u = numpy.arange(size * scale, dtype=numpy.float32) / scale
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
    """Parameters of the a-trous filter."""

    luminance: float  # widths of the stopping functions: in standard deviations of the noise,
    compress: float  # what is filtered is log(1 + c x) / c
    albedo_floor: float
    normal: float = 0.714  # and in units of the guides
    albedo: float = 2.24
    firefly: float = 60.0  # a pixel is at most that many times as bright as the second brightest around it


# By samples a pixel. Tuned with tune.py, which scores PSNR and RelMSE alike, on training views of 192 x 192: on 15 for
# all counts together, then what has no default on 20 for each.
TUNED = {
    2: Atrous(luminance=1.4, compress=0.35, albedo_floor=0.4),
    4: Atrous(luminance=1.4, compress=1.0, albedo_floor=0.4),
    8: Atrous(luminance=1.0, compress=1.0, albedo_floor=0.2),
}
LEVELS = 5
SPLINE = (1 / 16, 1 / 4, 3 / 8, 1 / 4, 1 / 16)
BINOMIAL = (1 / 4, 1 / 2, 1 / 4)
LUMINANCE = numpy.float32((0.2126, 0.7152, 0.0722))


def shifted(image, dy, dx):
    """image[y + dy, x + dx], edges replicated."""
    height, width = image.shape[:2]
    rows = (numpy.arange(height) + dy).clip(0, height - 1)
    columns = (numpy.arange(width) + dx).clip(0, width - 1)
    return image[rows][:, columns]


def window(radius):
    return [(dy, dx) for dy in range(-radius, radius + 1) for dx in range(-radius, radius + 1)]


def blurred(image):
    return sum(BINOMIAL[dy + 1] * BINOMIAL[dx + 1] * shifted(image, dy, dx) for dy, dx in window(1))


def without_fireflies(color, ratio):
    luminance = color @ LUMINANCE
    second = numpy.sort([shifted(luminance, *d) for d in window(1) if d != (0, 0)], axis=0)[-2]
    limit = ratio * second + 1e-3
    return color * numpy.minimum(1, limit / numpy.maximum(luminance, 1e-8))[..., None]


def noise_variance(luminance, guide_weights):
    """Of a pixel, from the 7x7 pixels around it that lie on the same surface."""
    first, second, weights = 0, 0, 0
    for d in window(3):
        near, weight = shifted(luminance, *d), guide_weights(*d)
        first, second, weights = first + weight * near, second + weight * near**2, weights + weight
    return numpy.maximum(second / weights - (first / weights) ** 2, 0)


def atrous_level(x, variance, guide_weights, step, width):
    luminance = blurred(x @ LUMINANCE)  # on single noisy pixels the stopping function would darken the image
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


def atrous(color, albedo, normal, p):
    """Scene linear [H, W, 3] each -> [H, W, 3].

    Dammertz et al. 2010, Edge-Avoiding A-Trous Wavelet Transform for fast Global Illumination Filtering, with the
    variance-normalised luminance weight and the demodulated albedo of Schied et al. 2017 (SVGF), section 4.
    """
    texture = albedo.clip(0, 1) + p.albedo_floor
    guides = numpy.concatenate([albedo.clip(0, 1) / p.albedo, normal.clip(-1, 1) / p.normal], -1)

    def guide_weights(dy, dx):
        return numpy.exp(-((shifted(guides, dy, dx) - guides) ** 2).sum(-1))

    x = numpy.log1p(p.compress * without_fireflies(color, p.firefly) / texture) / p.compress
    variance = noise_variance(x @ LUMINANCE, guide_weights)
    for level in range(LEVELS):
        x, variance = atrous_level(x, variance, guide_weights, 2**level, p.luminance)
    return numpy.expm1(p.compress * x) / p.compress * texture
