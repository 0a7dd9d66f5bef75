/* Sets the theme before the first paint: the remembered choice, else what the system asks for. A file of its own, because the
   content-security policy allows no inline script; not a module, because modules wait for the whole page. */
(() => {
  let chosen;
  try {
    chosen = localStorage.getItem("imuscope.theme");
  } catch {
    /* storage is blocked: follow the system */
  }
  const light = matchMedia("(prefers-color-scheme: light)").matches;
  document.documentElement.dataset.theme = chosen === "light" || chosen === "dark" ? chosen : light ? "light" : "dark";
})();
