/** The tasks in the order of boards. */
export const TASKS = ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"];
