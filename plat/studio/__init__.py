"""The keyframe studio: a web page on which timed keyframes are posed, played by real policies, scored and saved.

``plat studio`` opens it; ``docs/studio.md`` says how it is used. Needs the extra ``plat-rl[studio]``.
"""
