"""Numbers that Shibaike and Iwasaki print, for comparison with ours."""

LOBE_SHARES = {
    "human-black": (93.7, 3.04, 0.0057, 3.28, 0.00244),
    "human-white": (12.7, 34.0, 1.11, 50.5, 1.73),
    "raccoon": (14.6, 15.8, 1.01, 66.9, 1.68),
}
"""Percentages with which their method picks R, TT, TRT, TTs and TRTs (their tables 2 to 4)."""
