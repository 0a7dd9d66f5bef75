/** Name of the person at this browser, which is asked for once and logged with what that person does. */
const NAME_KEY = "imuscope.person";

export function storedName(): string {
  try {
    return localStorage.getItem(NAME_KEY) ?? "";
  } catch {
    return ""; // a browser may forbid it
  }
}

export function storeName(name: string): void {
  try {
    localStorage.setItem(NAME_KEY, name);
  } catch {
    // it is asked for again
  }
}
