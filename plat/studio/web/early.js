/* Before the scene is made: whether this browser draws in software, and whether it is dark. In software the scene has
   fewer pixels, unless the address says otherwise (?fixedDpr=1), no multisampling, which costs the most, and no shadows. */
(() => {
  "use strict";
  const probe = document.createElement("canvas").getContext("webgl2");
  const names = probe && probe.getExtension("WEBGL_debug_renderer_info");
  const renderer = names ? probe.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  if (probe) probe.getExtension("WEBGL_lose_context")?.loseContext();
  window.platSoftware = /swiftshader|llvmpipe|software|basic render/i.test(renderer);
  const address = new URL(location.href);
  if (matchMedia("(prefers-color-scheme: dark)").matches) address.searchParams.set("darkMode", "1");
  if (window.platSoftware) {
    if (!address.searchParams.has("fixedDpr")) address.searchParams.set("fixedDpr", "0.75");
    const { getContext } = HTMLCanvasElement.prototype;
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      return getContext.call(this, kind, /^webgl/.test(kind) ? { ...options, antialias: false, preserveDrawingBuffer: false } : options);
    };
  }
  if (address.href !== location.href) history.replaceState(null, "", address);
})();
