/** Loads every extension, so that each registers itself: a new one is a new folder, named nowhere else. */
import.meta.glob("./*/index.{ts,tsx}", { eager: true });
