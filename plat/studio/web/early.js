/* Before the scene is made: whether this browser draws in software, and whether it is dark. In software the scene has no
   multisampling, which costs the most, no shadows, and fewer pixels while something moves. */
(() => {
  "use strict";
  const SHARES = [0.75, 0.5], SLOW = 1000 / 15, REST = 400; // of width and height; ms a frame; ms without a frame
  const probe = document.createElement("canvas").getContext("webgl2");
  const names = probe && probe.getExtension("WEBGL_debug_renderer_info");
  const renderer = names ? probe.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  if (probe) probe.getExtension("WEBGL_lose_context")?.loseContext();
  window.platSoftware = /swiftshader|llvmpipe|software|basic render/i.test(renderer);
  window.platMoving = false; // a robot plays
  window.platBlind = probe ? "" : "WebGL is not available: turn on hardware acceleration in the settings of this browser, or try another one.";
  const address = new URL(location.href);
  if (matchMedia("(prefers-color-scheme: dark)").matches) address.searchParams.set("darkMode", "1");
  if (window.platSoftware) {
    // fixed, so that the library does not choose too; ?sharp draws all pixels always
    if (!address.searchParams.has("fixedDpr")) address.searchParams.set("fixedDpr", "1");
    const { getContext } = HTMLCanvasElement.prototype;
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      if (!/^webgl/.test(kind)) return getContext.call(this, kind, options);
      const gl = getContext.call(this, kind, { ...options, antialias: false, preserveDrawingBuffer: false });
      if (gl && kind === "webgl2" && this.isConnected && !this.platCoarse && !address.searchParams.has("sharp")) coarsen(gl);
      return gl;
    };
  }
  if (address.href !== location.href) history.replaceState(null, "", address);

  /* Give the canvas fewer pixels while something moves, the fewer the slower it draws, and all of them when it rests. The
     page goes on to think in all pixels: what it sets for the canvas is scaled. */
  function coarsen(gl) {
    const { canvas } = gl, asked = {}, { viewport, scissor, bindFramebuffer, clear } = gl;
    let share = 1, level = 0, port = null, box = null, elsewhere = null, drawn = -Infinity, gaps = [], pressed = false;
    canvas.platCoarse = true;
    const scaled = (sides) => sides.map((side) => Math.round(side * share));
    for (const side of ["width", "height"]) {
      const { get, set } = Object.getOwnPropertyDescriptor(HTMLCanvasElement.prototype, side);
      asked[side] = { value: get.call(canvas), apply: () => set.call(canvas, Math.max(Math.round(asked[side].value * share), 1)) };
      Object.defineProperty(canvas, side, {
        get: () => asked[side].value,
        set: (value) => { asked[side].value = value; asked[side].apply(); },
      });
    }
    gl.bindFramebuffer = (target, buffer) => {
      if (target !== gl.READ_FRAMEBUFFER) elsewhere = buffer;
      bindFramebuffer.call(gl, target, buffer);
    };
    gl.viewport = (...sides) => { if (!elsewhere) port = sides; viewport.apply(gl, elsewhere ? sides : scaled(sides)); };
    gl.scissor = (...sides) => { if (!elsewhere) box = sides; scissor.apply(gl, elsewhere ? sides : scaled(sides)); };
    gl.clear = (bits) => { // a picture begins
      if (!elsewhere && document.timeline.currentTime !== drawn) begin(document.timeline.currentTime);
      clear.call(gl, bits);
    };
    window.addEventListener("pointerdown", ({ target }) => { pressed = target === canvas; }, true);
    for (const kind of ["pointerup", "pointercancel"]) window.addEventListener(kind, () => { pressed = false; }, true);

    function begin(now) {
      const gap = now - drawn, moving = pressed || window.platMoving || gap < REST;
      drawn = now;
      if (!moving) gaps = [];
      else if (gap < 10 * REST) gaps.push(gap);
      if (gaps.length === 5) {
        const mean = gaps.reduce((a, b) => a + b) / 5;
        gaps = [];
        if (mean > SLOW) level = Math.min(level + 1, SHARES.length - 1);
        else if (mean < SLOW / 3) level = Math.max(level - 1, 0);
      }
      const wanted = moving ? SHARES[level] : 1;
      if (wanted === share) return;
      share = wanted;
      asked.width.apply();
      asked.height.apply();
      if (port) viewport.apply(gl, scaled(port));
      if (box) scissor.apply(gl, scaled(box));
    }
  }
})();
