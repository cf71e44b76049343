"""What ``python -m benchmarks`` runs, and the room that each is in."""

TIMINGS = {"versus_volprim": "renderers", "training_step": "engine", "lean": "engine"}
EXPERIMENTS = {
    "engine": ("cuts", "dog_share", "loss", "million", "mixed_sh", "scaling", "shifts", "slopes"),
    "processors": ("device_memory", "floor", "launches", "warps", "widths"),
    "renderers": ("ellipsoids", "renderers"),
    "numerics": ("curvature", "derivatives", "poison", "popping", "stiffness", "surfaces", "textures"),
    "training": (
        *("appearance", "depths", "disagreement", "dog_start", "exposures", "hdr", "misfits"),
        *("preconditioning", "rate_distortion", "scene_scale", "second_order", "simplify", "stretched"),
    ),
    "poses": ("poses", "refine_poses", "up"),
    "tracing": (
        *("denoising", "dogpath", "flicker", "indoors", "mesh_shadows", "rays", "shade", "splat_lamps"),
        "wavefronts",
    ),
}
"""Room to the experiments in it."""

ROOM_OF = TIMINGS | {name: room for room, names in EXPERIMENTS.items() for name in names}
