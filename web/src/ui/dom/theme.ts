/** Dark or light theme. The system decides until the user does; the choice is stored. The first paint is set by /theme.js. */
import { signal } from "@preact/signals";

export type Theme = "dark" | "light";

/** Storage key of the choice; also read by public/theme.js. */
const KEY = "imuscope.theme";
const system = matchMedia("(prefers-color-scheme: light)");

function remembered(): Theme | undefined {
  try {
    const value = localStorage.getItem(KEY);
    return value === "dark" || value === "light" ? value : undefined;
  } catch {
    return undefined; // storage is blocked: follow the system
  }
}

export const theme = signal<Theme>(remembered() ?? (system.matches ? "light" : "dark"));

function show(next: Theme): void {
  theme.value = next;
  document.documentElement.dataset["theme"] = next;
}

/** Applies the theme and follows the system while nothing was chosen. */
export function startTheme(): void {
  show(theme.value);
  system.addEventListener("change", () => {
    if (!remembered()) show(system.matches ? "light" : "dark");
  });
}

/** Switches to the other theme and stores it. */
export function toggleTheme(): void {
  const next = theme.value === "dark" ? "light" : "dark";
  try {
    localStorage.setItem(KEY, next);
  } catch {
    // not stored then; it still applies now
  }
  show(next);
}
