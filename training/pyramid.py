"""Defines the pyramid network: a U-Net whose kernels filter the light of both renders; see docs/model-format.md."""

import torch
import torch.nn.functional as F
from torch import nn

import model
from kernel_filter import kernel_filter, squared_distances
from model import conv

FILTERED_LEVELS = 3  # levels below the full size whose light is filtered
SIDE, ALBEDO_SIDE = 5, 3  # the sides of kernels that filter light, and of the one that filters albedo
GUIDE_CHANNELS = 12  # light, color, albedo and normal
GUIDES = 2  # a guided kernel has logits for its taps, and for the factors of albedo and normal
COMPRESS = 0.2  # light is log(1 + COMPRESS x) / COMPRESS
ALBEDO_AFFINITY, NORMAL_AFFINITY, MOST_FACTOR = 2.5**2, 1.5**2, 6.0


def compressed(x):
    return torch.log1p(COMPRESS * x) / COMPRESS


def expanded(light):
    return torch.expm1(COMPRESS * light) / COMPRESS


def doubled(x):
    return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


def padded(x, multiple):
    """Repeats the last row and column until both sides are multiples."""
    height, width = x.shape[-2:]
    return F.pad(x, (0, -width % multiple, 0, -height % multiple), mode="replicate")


class Pyramid(model.Kept):
    """Maps encoded inputs of padded sizes to logits of kernels, and at full size to what else makes the output."""

    def __init__(self, config):
        super().__init__()
        self.config = config
        widths = dict(enumerate(map(int, config.widths), 1))
        levels, joined = len(widths), config.halvings
        inputs = 3 + 3 * len(config.hrls_layers)
        self.hrls = conv(4 * inputs, widths[1])
        if config.knows_spp:
            self.hrls.by_spp = nn.Parameter(torch.zeros(widths[1]))
        if config.reads_lrhs:
            self.lrhs = conv(widths[joined] + 6, widths[joined])
            if len(config.lrhs_sampling) == 2:
                self.lrhs.centered_bias = nn.Parameter(self.lrhs.bias.detach().clone())
            if config.knows_spp:
                self.lrhs.by_spp = nn.Parameter(torch.zeros(widths[joined]))
        finer = range(1, levels)
        self.level = nn.ModuleDict({str(i): conv(widths[i], widths[i]) for i in finer if i != joined})
        self.down = nn.ModuleDict({str(i + 1): conv(4 * widths[i], widths[i + 1], 1) for i in finer})
        self.deep = nn.ModuleList(conv(widths[levels], widths[levels]) for _ in range(2))
        widths[0], skipped = config.upscaled_features, {0: GUIDE_CHANNELS} | {i: widths[i] for i in finer}
        self.up = nn.ModuleDict({str(i): conv(widths[i + 1], 4 * widths[i], 1) for i in (0, *finer)})
        self.join = nn.ModuleDict({str(i): conv(widths[i] + skipped[i], widths[i]) for i in (0, *finer)})
        self.kernel = nn.ModuleDict({str(i): conv(widths[i], SIDE**2 + GUIDES + (i + 1 < levels)) for i in finer})
        self.rec = conv(widths[0], 4 + ALBEDO_SIDE**2 + GUIDES + SIDE**2 + 1 + GUIDES)
        for predicts in (self.rec, *self.kernel.values()):
            predicts.weight.data.mul_(0.1)
            nn.init.zeros_(predicts.bias)
        # At first the filtered light counts most, and a pixel's own albedo seven tenths in its filtered one.
        self.rec.bias.data[3] = 2
        self.rec.bias.data[4 + ALBEDO_SIDE**2 // 2] = 3

    def biased(self, conv, y, log_spp, centered=None):
        """Adds what the bias of a convolution's result has more than conv.bias."""
        more = 0
        if self.config.knows_spp:
            more = conv.by_spp[:, None, None] * log_spp[:, None, None, None]
        if centered is not None and len(self.config.lrhs_sampling) == 2:
            more = more + (conv.centered_bias - conv.bias)[:, None, None] * centered
        return y if isinstance(more, int) else y + more.to(y.dtype)

    def level_layer(self, level, x, low, centered, log_spp):
        if level != self.config.halvings:
            return self.keep(f"level.{level}", x + F.relu(self.level[str(level)](x)))
        y = self.biased(self.lrhs, self.lrhs(torch.cat([x, low], dim=1)), log_spp[:, 0], centered)
        return self.keep("lrhs", x + F.relu(y))

    def joined(self, level, x, skipped):
        name = str(level)
        x = self.keep(f"up.{name}", F.pixel_shuffle(F.relu(self.up[name](x)), 2))
        return self.keep(f"join.{name}", F.relu(self.join[name](torch.cat([x, skipped], dim=1))))

    def forward(self, high, low, centered, spp):
        """Returns the output of rec and the logits of each level.

        `high` is the light of HRLS and its encoded layers, `low` the encoded LRHS and its light, or None.
        """
        dtype = model.multiplied_in(high)
        prepared = lambda x: x.to(dtype, memory_format=torch.channels_last)
        log_spp, centered = torch.log2(spp)[:, :, 0, 0], centered.reshape(-1, 1, 1, 1).to(dtype)
        low, guide = None if low is None else prepared(low), prepared(high[:, :GUIDE_CHANNELS])
        y = self.biased(self.hrls, self.hrls(prepared(F.pixel_unshuffle(high, 2))), log_spp[:, 1])
        x = self.keep("hrls", F.relu(y))
        skipped = []
        for level in range(1, len(self.config.widths)):
            skipped.append(self.level_layer(level, x, low, centered, log_spp))
            x = F.relu(self.down[str(level + 1)](F.pixel_unshuffle(skipped[-1], 2)))
            self.keep(f"down.{level + 1}", x)
        for i, layer in enumerate(self.deep):
            x = self.keep(f"deep.{i}", x + F.relu(layer(x)))
        logits = {}
        for level in reversed(range(1, len(self.config.widths))):
            x = self.joined(level, x, skipped[level - 1])
            logits[level] = self.keep(f"kernel.{level}", self.kernel[str(level)](x))
        rec = self.keep("rec", self.rec(self.joined(0, x, guide)))
        return model.widened(rec), {level: model.widened(y) for level, y in logits.items()}


def lights_of(network, color, albedo, lrhs, centered, spp):
    """Returns the light of HRLS at full size and of both renders at each level, and that of LRHS alone, if any."""
    config, keep = network.config, network.keep
    demodulated = model.without_fireflies(color) / (albedo + model.ALBEDO_FLOOR)
    own = share = None
    if config.reads_lrhs:
        pixels = config.scale**2
        certainty = torch.as_tensor(config.lrhs_certainty, dtype=lrhs.dtype, device=lrhs.device)
        if config.knows_spp:
            certainty = certainty * spp[:, :1] / (spp[:, 1:] * pixels)
        share = certainty / (certainty + pixels)
        shown = (..., slice(None, None, config.scale), slice(None, None, config.scale))  # a decimated LRHS shows these
        given, at = lrhs / (albedo[shown] + model.ALBEDO_FLOOR), demodulated[shown]
        demodulated[shown] = torch.where(centered, at, (at + certainty * given) / (1 + certainty))
        surface = torch.where(centered, F.avg_pool2d(albedo, config.scale), albedo[shown])
        own = keep("cell_light", compressed(lrhs / (surface + model.ALBEDO_FLOOR)))
    lights = [keep("light", compressed(demodulated))]
    for level in range(1, FILTERED_LEVELS + 1):
        mean = F.avg_pool2d(lights[-1], 2)
        lights.append(keep(f"pool.{level}", mean.lerp(own, share) if level == config.halvings else mean))
    return lights, own


class Guides:
    """Guides kernels of a level by albedo and normal [N, 6, H, W]."""

    def __init__(self, images):
        self.images, self.distances = images, {}

    def logits(self, kernel, factors):
        """Returns logits that lose what pixels are unlike; `factors` are the logits of the guides' factors."""
        side = int(kernel.shape[1] ** 0.5)
        if side not in self.distances:
            self.distances[side] = [squared_distances(image, side) for image in self.images.split(3, dim=1)]
        albedo, normal = self.distances[side]
        of_albedo, of_normal = factors.clamp(-MOST_FACTOR, MOST_FACTOR).exp().split(1, dim=1)
        return kernel - (ALBEDO_AFFINITY * of_albedo * albedo + NORMAL_AFFINITY * of_normal * normal)


def filtered(light, guides, logits, coarse=None):
    """Filters `light` by a guided kernel, and blends it with `coarse`."""
    shares = 0 if coarse is None else 1
    kernel, share, factors = logits.split([SIDE**2, shares, GUIDES], dim=1)
    result = kernel_filter(light, guides.logits(kernel, factors))
    return result if coarse is None else result.lerp(doubled(coarse), torch.sigmoid(share))


def predict(network, lrhs, hrls, upsampled, centered, spp):
    """Computes the encoded image of model.predict() for a pyramid network.

    At a scale of 1 `lrhs` is the color of HRLS.
    """
    config, keep = network.config, network.keep
    multiple = 2 ** len(config.widths)
    high = padded(model.encode(hrls, config.hrls_layers, config), multiple)
    low = high[:, :3]
    if config.reads_lrhs:
        low = padded(model.encode(lrhs, ("color",), config), multiple // config.scale)
    albedo = high[:, 3:6]
    color, linear_lrhs = (model.decode(x, config.transfer) for x in (high[:, :3], low))
    lights, own = lights_of(network, color, albedo, linear_lrhs, centered, spp)
    guides = [Guides(high[:, 3:9])]
    for level in range(1, FILTERED_LEVELS + 1):
        guides.append(Guides(keep(f"guides.{level}", F.avg_pool2d(guides[-1].images, 2))))
    both = None if own is None else torch.cat([low, own], dim=1)
    rec, logits = network(torch.cat([lights[0], high], dim=1), both, centered, spp)
    coarse = None
    for level in reversed(range(1, FILTERED_LEVELS + 1)):
        coarse = keep(f"filter.{level}", filtered(lights[level], guides[level], logits[level], coarse))
    residual, share, surface, factors, kernel = rec.split([3, 1, ALBEDO_SIDE**2, GUIDES, SIDE**2 + 1 + GUIDES], dim=1)
    lit = keep("filter.0", filtered(lights[0], guides[0], kernel, coarse))
    albedo = kernel_filter(albedo, guides[0].logits(surface, factors))
    textured = expanded(lit) * (albedo + model.ALBEDO_FLOOR)
    base = upsampled(low)
    mixed = base.lerp(model.transfer(textured, config.transfer), torch.sigmoid(share))
    y = keep("compose", residual + mixed)
    return y[..., : hrls.shape[-2], : hrls.shape[-1]]
