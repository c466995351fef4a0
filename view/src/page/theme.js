// The page in dark or light colours: as the system is, until somebody chooses. Runs before the page is painted; what is drawn on
// canvases asks for the colours of style.css.

(() => {
  const system = matchMedia("(prefers-color-scheme: light)");
  const ofSystem = () => (system.matches ? "light" : "dark");
  const root = document.documentElement;
  let memo = {};

  function stored() {
    try {
      const theme = localStorage.getItem("theme");
      return ["light", "dark"].includes(theme) ? theme : null;
    } catch {
      // Storage may be forbidden; then the choice lasts as long as the page.
      return root.dataset.chosen ?? null;
    }
  }

  function apply() {
    root.dataset.theme = stored() ?? ofSystem();
    memo = {};
    dispatchEvent(new Event("theme"));
  }

  /** Chooses the other one. What the system has anyway is followed from then on, not remembered. */
  function toggle() {
    const theme = root.dataset.theme === "light" ? "dark" : "light";
    const follows = theme === ofSystem();
    try {
      if (follows) localStorage.removeItem("theme");
      else localStorage.setItem("theme", theme);
    } catch {
      if (follows) delete root.dataset.chosen;
      else root.dataset.chosen = theme;
    }
    apply();
  }

  /** A colour of the theme in force, by the name of its variable in style.css without the dashes. */
  function colour(name) {
    return (memo[name] ??= getComputedStyle(root).getPropertyValue(`--${name}`).trim());
  }

  system.addEventListener("change", apply);
  // Another page of this program chose.
  addEventListener("storage", (event) => event.key === "theme" && apply());
  globalThis.theme = { toggle, colour, get name() { return root.dataset.theme; } };
  apply();
})();
