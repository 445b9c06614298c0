-- Games that were read from files of the public data format. Nobody vouches for them: their states are
-- those that were recorded, and no rule was applied to them. Only the writer task changes these tables.

CREATE TABLE imports (
    key          INTEGER PRIMARY KEY,
    id           TEXT    NOT NULL UNIQUE,
    digest       BLOB    NOT NULL UNIQUE,            -- of settings and states: the same game is kept once
    run_id       TEXT    NOT NULL,                   -- as the files call it
    meta         TEXT    NOT NULL,                   -- its entry in the index
    model        TEXT    NOT NULL,
    task         TEXT    NOT NULL,
    seed         INTEGER NOT NULL,
    settings     TEXT    NOT NULL,                   -- those that make games comparable
    score        REAL    NOT NULL,
    rounds       INTEGER NOT NULL,                   -- resolved ones: one fewer than states
    acts         INTEGER NOT NULL,                   -- 0 where the file with them could not be read
    imported_at  INTEGER NOT NULL
) STRICT;

CREATE INDEX imports_by_task  ON imports (task, key);
CREATE INDEX imports_by_model ON imports (model, key);

CREATE TABLE import_rounds (
    import  INTEGER NOT NULL,
    round   INTEGER NOT NULL,
    score   REAL    NOT NULL,
    state   TEXT    NOT NULL,
    acts    BLOB,                                    -- given in this state; gzip of JSON Lines
    PRIMARY KEY (import, round)
) STRICT, WITHOUT ROWID;
