"""Keyframe studio: a web page to pose, play, score and save timed keyframes.

``plat studio`` opens it; ``docs/studio.md`` says how it is used. Needs the extra ``plat-rl[studio]``.
"""
