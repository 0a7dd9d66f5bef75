/** Loads every file of this folder, so that each panel registers itself: a new one is a new file, named nowhere else. */
import.meta.glob(["./*.ts", "./*.tsx", "!./*.test.*", "!./all.ts"], { eager: true });
