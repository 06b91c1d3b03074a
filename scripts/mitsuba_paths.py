"""Mitsuba's path tracer, for scripts that compare it with bdpm. Wants Mitsuba 3 (`pip install mitsuba numpy`)."""

import mitsuba

mitsuba.set_variant("llvm_ad_rgb")

import drjit  # noqa: E402
import numpy as np  # noqa: E402

# Samples of one call: Mitsuba holds them all in memory
PASS = 1 << 21


class PathTracer:
    """Mitsuba's path tracer without a limit of depth, with a box filter, at a width of the image."""

    def __init__(self, path, width, threads):
        # With one thread, reading an environment map waits forever
        drjit.set_thread_count(2)
        mitsuba.file_resolver().prepend(str(path.parent))
        self.scene = mitsuba.load_file(str(path))
        film = mitsuba.traverse(self.scene.sensors()[0])
        w, h = film["film.size"]
        self.size = (width, round(width * h / w))
        film["film.size"] = list(self.size)
        film.update()
        drjit.set_thread_count(threads)
        self.integrator = mitsuba.load_dict({"type": "path", "max_depth": -1, "rr_depth": 5})
        # Samples per pixel of a pass
        self.samples = max(1, PASS // (self.size[0] * self.size[1]))
        # The first pass compiles the kernel
        self.render_pass(0)

    def render_pass(self, seed):
        """The image of one pass, height by width by channels."""
        image = mitsuba.render(self.scene, integrator=self.integrator, spp=self.samples, seed=seed)
        return np.array(image)
