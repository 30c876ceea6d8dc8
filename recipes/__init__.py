"""The training stages as scripts: expert, distill, refine; the grid of ablations; and a demo of all.

Read them top to bottom, or copy one to change it: they use public names of plat only. ``plat expert`` runs
``expert.py``, and so on; ``plat.recipes`` is this folder, and the wheel carries it under that name.
"""
