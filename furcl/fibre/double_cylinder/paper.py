"""Numbers that Shibaike and Iwasaki print, for comparison with ours."""

LOBE_SHARES = {
    "human-black": (93.7, 3.04, 0.0057, 3.28, 0.00244),
    "human-white": (12.7, 34.0, 1.11, 50.5, 1.73),
    "raccoon": (14.6, 15.8, 1.01, 66.9, 1.68),
}
"""Percentages with which their method picks R, TT, TRT, TTs and TRTs (their tables 2 to 4)."""

CONVENTIONAL_LOBE_SHARES = {
    "human-black": (95.1, 1.11, 0.000348, 3.77, 0.000697),
    "human-white": (11.8, 31.1, 0.997, 54.5, 1.49),
    "raccoon": (13.2, 13.7, 0.739, 71.0, 1.34),
}
"""The same of the conventional method, h uniform and then the lobe (the same tables)."""

RMSE_RATIOS = {
    "human-black": ("equal time", {64: 0.91, 128: 0.84, 256: 0.77, 512: 0.76}),
    "human-white": ("equal spp", {64: 0.97, 128: 0.97, 256: 0.98, 512: 0.98}),
    "raccoon": ("equal spp", {64: 0.98, 128: 0.98, 256: 0.97, 512: 0.98}),
}
"""RMSE of their method over that of the conventional one, by samples a pixel: at equal time (table
5) or at equal samples (tables 6 and 7)."""
