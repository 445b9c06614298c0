// What a swarm has to do in each task.

/** The tasks in the order of boards. */
export const TASKS = ["Transport", "Pursuit", "Synchronization", "Foraging", "Flocking"];

/** What a swarm has to do: in a few words, and in a sentence with what scores. @type {Record<string, [string, string]>} */
export const GOALS = {
  Transport: ["push the block out", "The agents push a heavy block out through the gap in the wall and leave behind it: the sooner an agent is outside, the more it scores."],
  Pursuit: ["surround the prey", "The agents surround a prey that flees: a point each time no cell beside it is empty, and another prey comes."],
  Synchronization: ["switch lights together", "Each agent switches its own light: a point each time all are on, or all off, in turn."],
  Foraging: ["carry food to the nest", "The agents carry food from its source to the nest: a point for each load."],
  Flocking: ["form a square", "The agents form the outline of a square: the score is how much closer to it they came than at the start."],
};
