"""The models side by side: what each changes in the droplet's scene, and its number in Jiang & Zhu's table 1."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from refsim import (
    Akinci2013,
    BeckerTeschner2007,
    CsfWang2019,
    Dong2016,
    He2014,
    ImplicitPressure,
    TartakovskyMeakin2005,
)


@dataclass(frozen=True)
class Model:
    """One model at the best settings found for it.

    words     what it is called
    paper     seconds to steady state that Jiang & Zhu's table 1 gives; None where it is not in it
    changes   parameters of `droplet_scene`
    """

    words: str
    paper: float | None
    changes: Mapping[str, Any]


_SHORT, _LONG = {"support": 2.0, "kernels": "mueller"}, {"support": 2.7, "kernels": "wendland"}
MODELS: dict[str, Model] = {
    "jiang_zhu": Model("Jiang & Zhu 2023", 30.3, {}),
    "csf": Model(
        "[6] continuum surface force", 34.6, {"effects": (CsfWang2019(surface_tension=1.0),), "viscosity": 0.3, **_LONG}
    ),
    "becker_teschner": Model(
        "[8] Becker & Teschner 2007",
        36.0,
        {"effects": (BeckerTeschner2007(surface_tension=1.0, balance_pressure=False),), **_SHORT},
    ),
    "akinci": Model(
        "[9] Akinci 2013", 35.1, {"effects": (Akinci2013(surface_tension=1.0, balance_pressure=False),), **_SHORT}
    ),
    "akinci_iisph": Model(
        "[12] Akinci 2013 on IISPH", 34.3, {"effects": (Akinci2013(surface_tension=1.0), ImplicitPressure()), **_SHORT}
    ),
    "dong": Model("Dong 2016", None, {"effects": (Dong2016(surface_tension=1.0),), **_LONG}),
    "tartakovsky_meakin": Model(
        "Tartakovsky & Meakin 2005",
        None,
        {"effects": (TartakovskyMeakin2005(surface_tension=1.0, balance_pressure=False),), "support": 2.7},
    ),
    "he": Model("He 2014", None, {"effects": (He2014(surface_tension=0.1),), **_LONG}),
}
# For the claims alone: as in the paper, which leaves h, viscosity and sound speed open, and a rival at the same ones.
EQUAL: dict[str, Model] = {
    "jiang_zhu_paper": Model(
        "Jiang & Zhu 2023, its own choices", 30.3, {"literal": ("paper",), "tension": {"literal": ("paper",)}}
    ),
    "jiang_zhu_clamped": Model(
        "the same, negative pressures clamped", 30.3, {"literal": ("E24",), "tension": {"literal": ("paper",)}}
    ),
    "jiang_zhu_either": Model(
        "pairs with one particle in S, all else refsim's", 30.3, {"tension": {"pair_mode": "either"}}
    ),
    "akinci_equal": Model(
        "[9] Akinci 2013 at Jiang & Zhu's settings", 35.1, {"effects": (Akinci2013(surface_tension=1.0),)}
    ),
    "becker_teschner_printed": Model(  # as printed, where that differs from what is shown above
        "[8] Becker & Teschner 2007 as printed",
        36.0,
        {"effects": (BeckerTeschner2007(surface_tension=1.0, clamp_distance=False, balance_pressure=False),), **_SHORT},
    ),
}
