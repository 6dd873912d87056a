"""Pictures, films and a page for the browser from a finished run.

Contents: saved_run (a run read back), surfaces (from particles to a surface), looks (cameras, styles, materials), space
(pictures in 3D, by PyVista), plane (pictures in 2D, by matplotlib), pictures (labels, files, films), view (the page).
PyVista and imageio are imported where they are used; they come with `pip install "refsim[view]"`.
"""
