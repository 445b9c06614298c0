-- Runs: a suite of games for one model. Competitions: runs on seeds that nobody knows before the end.

CREATE TABLE runs (
    key               INTEGER PRIMARY KEY,
    id                TEXT    NOT NULL UNIQUE,
    owner             INTEGER,                       -- keys.number; none where nobody showed a key
    suite             TEXT    NOT NULL,              -- its name
    digest            TEXT    NOT NULL,              -- of all of the suite: games with other settings are never compared
    definition        TEXT    NOT NULL,              -- JSON: what is played, and by whom
    model             TEXT    NOT NULL,
    visibility        TEXT    NOT NULL,              -- public owner sealed: who may see it, as for its episodes
    status            TEXT    NOT NULL,              -- running finished aborted abandoned closed
    entry             INTEGER,                       -- entries.key of an attempt in a competition
    attempt           INTEGER,                       -- its number, from 1
    voided_at         INTEGER,                       -- the host broke it: it does not count as an attempt
    void_reason       TEXT,
    created_at        INTEGER NOT NULL,              -- all times: milliseconds since 1970
    ended_at          INTEGER,
    idempotency_key   TEXT UNIQUE,
    idempotency_body  BLOB
) STRICT;

CREATE INDEX runs_by_status ON runs (status, key);
CREATE INDEX runs_by_owner  ON runs (owner, key);
CREATE INDEX runs_by_entry  ON runs (entry, attempt);
CREATE INDEX runs_by_suite  ON runs (suite, key);
CREATE INDEX runs_by_model  ON runs (model, key);

ALTER TABLE episodes ADD COLUMN run INTEGER;         -- runs.key
ALTER TABLE episodes ADD COLUMN slot INTEGER;        -- which game of the run's plan it is, from 0
ALTER TABLE episodes ADD COLUMN seating TEXT;        -- the record of who holds which seat, to the byte
ALTER TABLE episodes ADD COLUMN voided_at INTEGER;   -- the host broke it: it counts nowhere
ALTER TABLE episodes ADD COLUMN void_reason TEXT;
ALTER TABLE episodes ADD COLUMN revealed INTEGER NOT NULL DEFAULT 0;  -- 1 once a sealed one is open to all
CREATE INDEX episodes_by_run ON episodes (run, slot);

-- What boards are made of: a row for each ended episode of a run or of several holders. All of it follows from the
-- journal; `swarmbench board rebuild` drops it and makes it again.
CREATE TABLE results (
    episode            INTEGER PRIMARY KEY,
    task               TEXT    NOT NULL,
    seed               INTEGER NOT NULL,
    score              REAL    NOT NULL,
    rounds             INTEGER NOT NULL,
    status             TEXT    NOT NULL,
    acts               INTEGER NOT NULL,             -- that players decided
    invalid            INTEGER NOT NULL,             -- of these: answers that were none
    clock_outs         INTEGER NOT NULL,             -- that a clock decided
    prompt_tokens      INTEGER NOT NULL,
    completion_tokens  INTEGER NOT NULL
) STRICT;

-- Who holds the seats of episodes that have several holders. Other episodes have no rows here.
CREATE TABLE seats (
    episode     INTEGER NOT NULL,
    agent       INTEGER NOT NULL,
    holder      INTEGER NOT NULL,                    -- the number of the claim in its episode; 0: the creator
    owner       INTEGER,                             -- keys.number of the holder
    model       TEXT    NOT NULL,
    player      TEXT,                                -- the built-in player that the server hosts here
    claimed_at  INTEGER NOT NULL,
    PRIMARY KEY (episode, agent)
) STRICT, WITHOUT ROWID;

-- The holders of such seats, and whoever created an episode of which the server hosts seats: what they told of who plays.
CREATE TABLE claims (
    episode           INTEGER NOT NULL,
    holder            INTEGER NOT NULL,              -- 0: the creator
    owner             INTEGER,                       -- keys.number
    key               TEXT,                          -- the public id of that key
    model             TEXT    NOT NULL,
    agent_meta        TEXT    NOT NULL,              -- JSON
    player            TEXT,                          -- the built-in player that the server hosts on these seats
    claimed_at        INTEGER NOT NULL,
    idempotency_key   TEXT UNIQUE,
    idempotency_body  BLOB,
    PRIMARY KEY (episode, holder)
) STRICT, WITHOUT ROWID;

-- Tokens of episodes, and now of runs, too.
DROP INDEX tokens_by_episode;
ALTER TABLE tokens RENAME TO tokens_of_episodes;
CREATE TABLE tokens (
    hash     BLOB    PRIMARY KEY,                    -- of the token; the token itself is not kept
    episode  INTEGER,
    agent    INTEGER,                                -- none: several seats of the episode
    holder   INTEGER,                                -- of which claim; none: the creator's
    run      INTEGER                                 -- instead of an episode: all seats of all its episodes
) STRICT, WITHOUT ROWID;
INSERT INTO tokens (hash, episode, agent) SELECT hash, episode, agent FROM tokens_of_episodes;
DROP TABLE tokens_of_episodes;
CREATE INDEX tokens_by_episode ON tokens (episode);
CREATE INDEX tokens_by_run     ON tokens (run);

CREATE TABLE competitions (
    key           INTEGER PRIMARY KEY,
    id            TEXT    NOT NULL UNIQUE,
    definition    TEXT    NOT NULL,                  -- JSON, as it was accepted
    salt          BLOB    NOT NULL,                  -- 32 bytes
    seeds         BLOB    NOT NULL,                  -- 16 bytes each, attempt by attempt
    commitment    BLOB    NOT NULL,                  -- SHA-256 of salt and seeds
    opens_at      INTEGER NOT NULL,
    closes_at     INTEGER NOT NULL,
    created_at    INTEGER NOT NULL,
    revealed_at   INTEGER
) STRICT;

-- Who takes part, with which model.
CREATE TABLE entries (
    key            INTEGER PRIMARY KEY,
    id             TEXT    NOT NULL UNIQUE,
    competition    INTEGER NOT NULL,
    owner          INTEGER NOT NULL,                 -- keys.number
    name           TEXT    NOT NULL,
    model          TEXT    NOT NULL,
    declaration    TEXT    NOT NULL,                 -- JSON: all that was declared
    template       TEXT,                             -- tells prompt templates apart, which are large
    status         TEXT    NOT NULL,                 -- active withdrawn disqualified
    reason         TEXT,
    vouched        INTEGER NOT NULL DEFAULT 0,
    registered_at  INTEGER NOT NULL
) STRICT;

CREATE INDEX entries_by_competition ON entries (competition, key);
CREATE INDEX entries_by_owner       ON entries (owner, key);

CREATE TABLE invitations (
    hash         BLOB    PRIMARY KEY,                -- of the code; the code itself is not kept
    competition  INTEGER NOT NULL,
    label        TEXT    NOT NULL,
    entry        INTEGER,                            -- who used it
    created_at   INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

-- What organizers did.
CREATE TABLE audit (
    number   INTEGER PRIMARY KEY,
    at       INTEGER NOT NULL,
    who      TEXT    NOT NULL,                       -- the id of the key, or `local` for the server's own machine
    action   TEXT    NOT NULL,
    subject  TEXT    NOT NULL,                       -- the id of what it was done to
    detail   TEXT    NOT NULL                        -- JSON
) STRICT;
