// Parts of a game's page that are read when they are first needed. A page that is one file has them all.

export const PARTS = { codes: () => import("../parts/codes.js"), later: () => import("./later.js") };
