-- What several servers share that play on one database. SQLite has none of it.

-- The time of day by the clock of the database, in milliseconds: the only clock by which a server is alive or not.
CREATE FUNCTION now_ms() RETURNS bigint LANGUAGE sql VOLATILE
    AS 'SELECT CAST(extract(epoch FROM clock_timestamp()) * 1000 AS bigint)';

-- The servers that play together, each with its row in `nodes`. Whoever takes over the work of one that was not seen for too
-- long deletes this row first: a beat that comes later finds nothing.
CREATE TABLE members (
    incarnation  bigint   PRIMARY KEY REFERENCES nodes ON DELETE CASCADE,
    slot         smallint NOT NULL UNIQUE,             -- a part of the numbers that it gives
    address      text     COLLATE "C" NOT NULL,        -- where the others reach it
    version      text     COLLATE "C" NOT NULL,        -- of the program
    beat_at      bigint   NOT NULL,                    -- when it was last seen, by the clock of the database
    offset_ms    bigint   NOT NULL DEFAULT 0,          -- its clock minus that of the database
    is_ready     boolean  NOT NULL DEFAULT false,      -- takes work
    seen         bigint   NOT NULL,                    -- the revision of `cluster` by which it acts
    episodes     integer  NOT NULL DEFAULT 0,          -- in memory
    places       integer  NOT NULL DEFAULT 0           -- what it plays, or has taken
) WITH (fillfactor = 50);

-- Who plays what: a game without a run, a run with its games, or a competition. Where there is no row, nobody does.
CREATE TABLE places (
    kind   smallint NOT NULL,                          -- 0 game, 1 run, 2 competition
    key    bigint   NOT NULL,
    owner  bigint   NOT NULL REFERENCES nodes ON DELETE CASCADE,
    taking bigint   GENERATED ALWAYS AS IDENTITY,      -- the row is given back by this number, so that an old attempt gives back no newer row
    PRIMARY KEY (kind, key)
);

CREATE INDEX places_owner ON places (owner);

CREATE UNIQUE INDEX places_taking ON places (taking);

-- One row: what all members have in common.
CREATE TABLE cluster (
    one       boolean PRIMARY KEY DEFAULT true CHECK (one),
    secret    bytea   NOT NULL,                        -- a digest of the secret
    revision  bigint  NOT NULL DEFAULT 0               -- counted up whenever a token or a key was revoked
);

-- What boards of other members have to read again, by the transaction that wrote it. Old rows are deleted.
CREATE TABLE changes (
    xid    xid8     NOT NULL DEFAULT pg_current_xact_id(),
    owner  bigint   NOT NULL,                          -- who wrote it
    kind   smallint NOT NULL,
    key    bigint   NOT NULL,
    at     bigint   NOT NULL
);

CREATE INDEX changes_xid ON changes (xid);
