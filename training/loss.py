"""Computes losses on encoded and scene linear images, and the metrics of the paper."""

import torch


def rms(encoded, encoded_reference):
    """Computes the root of each image's mean squared error, and the mean over the images.

    If an edge may lie in either of two places, the mean of both is best, as for PSNR; l1() prefers the likelier one.
    """
    return ((encoded - encoded_reference) ** 2).mean(dim=(1, 2, 3)).add(1e-8).sqrt().mean()


def robust(fused, reference, beta=0.1):
    """Computes Equation 10 on scene linear values."""
    difference = (fused - reference).abs()
    return (difference / (beta + difference)).mean()


def l1(encoded, encoded_reference):
    return (encoded - encoded_reference).abs().mean()


def srgb(x):
    """Applies the sRGB transfer function, Equation 3."""
    x = x.clamp(0, 1)
    return torch.where(x <= 0.0031308, 12.92 * x, 1.055 * x.clamp(min=1e-8) ** (1 / 2.4) - 0.055)


def psnr(image, reference):
    """Computes the PSNR in sRGB, in decibels."""
    return float(-10 * torch.log10(((srgb(image) - srgb(reference)) ** 2).mean()))


def relmse(image, reference, scale=0.5, floor=0.01):
    """Computes Equation 11 on scene linear values."""
    return float((scale * (image - reference) ** 2 / (reference**2 + floor)).mean())
