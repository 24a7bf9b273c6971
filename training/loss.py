"""Losses on encoded and scene linear images, and the metrics of the paper."""

import torch


def rms(encoded, encoded_reference):
    """The root of each image's mean squared error.

    Where an edge may lie here or there, it asks for the mean of both, as PSNR does, and l1 for the likelier one.
    """
    return ((encoded - encoded_reference) ** 2).mean(dim=(1, 2, 3)).add(1e-8).sqrt().mean()


def robust(fused, reference, beta=0.1):
    """Equation 10, scene linear."""
    difference = (fused - reference).abs()
    return (difference / (beta + difference)).mean()


def l1(encoded, encoded_reference):
    return (encoded - encoded_reference).abs().mean()


def srgb(x):
    """Equation 3."""
    x = x.clamp(0, 1)
    return torch.where(x <= 0.0031308, 12.92 * x, 1.055 * x.clamp(min=1e-8) ** (1 / 2.4) - 0.055)


def psnr(image, reference):
    """In sRGB, decibels."""
    return float(-10 * torch.log10(((srgb(image) - srgb(reference)) ** 2).mean()))


def relmse(image, reference, scale=0.5, floor=0.01):
    """Equation 11, scene linear."""
    return float((scale * (image - reference) ** 2 / (reference**2 + floor)).mean())
