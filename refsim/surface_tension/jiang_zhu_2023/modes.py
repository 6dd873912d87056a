"""Names of the pair modes and area terms as compiled code and references take them."""

SOFT, ALL, ONE_SIDED, EITHER, BOTH = range(5)
PAIR_MODES = {"soft": SOFT, "all": ALL, "one_sided": ONE_SIDED, "either": EITHER, "both": BOTH}

CORRECTED, COLOR = range(2)
AREA_TERMS = {"corrected": CORRECTED, "color": COLOR}
