"""Names the filters of a plain render that a model has to beat, with their parameters by samples a pixel."""

from evaluation.baselines import Atrous, Svgf, atrous, svgf
from evaluation.nfor import Nfor, nfor

FILTERS = {"atrous": atrous, "svgf": svgf, "nfor": nfor}

# The keys are samples a pixel. The values were tuned on 29 training views, those of nfor on 6, scored as in tune.py.
TUNED = {
    "atrous": {
        2: Atrous(compress=2.24, color=1.28, albedo=0.255, normal=0.7),
        4: Atrous(compress=6.27, color=0.429, albedo=0.149, normal=0.7),
        8: Atrous(compress=8.4, color=0.238, albedo=0.107, normal=0.5),
    },
    "svgf": {
        2: Svgf(luminance=2.0, compress=0.0875, albedo_floor=0.672, normal=0.833, albedo=1.12, firefly=60.0),
        4: Svgf(luminance=1.4, compress=0.5, albedo_floor=0.4, normal=0.595, albedo=1.34, firefly=60.0),
        8: Svgf(luminance=1.2, compress=1.0, albedo_floor=0.143, normal=0.357, albedo=2.24, firefly=30.0),
    },
    "nfor": {
        2: Nfor(color=0.321, compress=1.0, albedo_floor=0.4, normal=1.68, albedo=1.3, alike=1.0, firefly=60.0),
        4: Nfor(color=0.161, compress=4.0, albedo_floor=0.4, normal=1.2, albedo=1.3, alike=1.0, firefly=60.0),
        8: Nfor(color=0.315, compress=8.0, albedo_floor=0.143, normal=0.56, albedo=0.5, alike=1.0, firefly=30.0),
    },
}
