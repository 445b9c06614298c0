-- The journal of all episodes. Only the writer task changes it. States, observations and scores are
-- recomputed from it. Task, model, visibility and status of an episode stand beside its records so that
-- lists can be filtered without reading them.

CREATE TABLE episodes (
    key               INTEGER PRIMARY KEY,
    id                TEXT    NOT NULL UNIQUE,
    opening           TEXT    NOT NULL,              -- the first record, to the byte
    task              TEXT    NOT NULL,
    model             TEXT    NOT NULL,
    visibility        TEXT    NOT NULL,
    status            TEXT    NOT NULL,              -- waiting running finished aborted abandoned
    clocked           INTEGER NOT NULL,              -- 1 where rounds have a deadline
    head              BLOB    NOT NULL,              -- of the chain after the opening, or the end
    ending            TEXT,                          -- the last record, to the byte
    created_at        INTEGER NOT NULL,              -- all times: milliseconds since 1970
    started_at        INTEGER,                       -- of a manual start
    ended_at          INTEGER,
    idempotency_key   TEXT UNIQUE,
    idempotency_body  BLOB
) STRICT;

CREATE INDEX episodes_by_status ON episodes (status, key);
CREATE INDEX episodes_by_task   ON episodes (task, key);
CREATE INDEX episodes_by_model  ON episodes (model, key);

CREATE TABLE acts (
    episode      INTEGER NOT NULL,
    round        INTEGER NOT NULL,
    agent        INTEGER NOT NULL,
    waiting_for  INTEGER NOT NULL,                   -- as it was answered first
    at           INTEGER NOT NULL,
    record       TEXT    NOT NULL,                   -- to the byte
    PRIMARY KEY (episode, round, agent)
) STRICT;

CREATE TABLE rounds (
    episode  INTEGER NOT NULL,
    round    INTEGER NOT NULL,
    digest   BLOB    NOT NULL,
    score    REAL    NOT NULL,
    head     BLOB    NOT NULL,
    at       INTEGER NOT NULL,
    PRIMARY KEY (episode, round)
) STRICT, WITHOUT ROWID;

CREATE TABLE tokens (
    hash     BLOB    PRIMARY KEY,                    -- of the token; the token itself is not kept
    episode  INTEGER NOT NULL,
    agent    INTEGER                                 -- none: all seats of the episode
) STRICT, WITHOUT ROWID;

CREATE INDEX tokens_by_episode ON tokens (episode);
