-- Metrics of games that have ended. They follow from the journals: `board rebuild` makes them again.
CREATE TABLE metrics (
    episode   INTEGER NOT NULL,
    embedder  TEXT    NOT NULL,          -- what turned texts into vectors
    revision  INTEGER NOT NULL,          -- of all definitions
    measured  TEXT    NOT NULL,          -- the values, as JSON
    PRIMARY KEY (episode, embedder)
) STRICT, WITHOUT ROWID;

-- Games that have ended and were not measured yet, in the order of their ends.
CREATE TABLE unmeasured (
    number   INTEGER PRIMARY KEY,
    episode  INTEGER NOT NULL
) STRICT;
