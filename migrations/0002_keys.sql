-- Keys for people, and what the holder of a key created. A row is never deleted: a server that had a
-- key once asks for one for ever.

CREATE TABLE keys (
    number      INTEGER PRIMARY KEY,
    id          TEXT    NOT NULL UNIQUE,
    hash        BLOB    NOT NULL UNIQUE,             -- of the key; the key itself is not kept
    role        TEXT    NOT NULL,                    -- member organizer
    name        TEXT    NOT NULL,
    created_at  INTEGER NOT NULL,
    expires_at  INTEGER,
    revoked_at  INTEGER
) STRICT;

ALTER TABLE episodes ADD COLUMN owner INTEGER;       -- keys.number; none where nobody showed a key
ALTER TABLE episodes ADD COLUMN bytes INTEGER;       -- that its acts take; known at the end

CREATE INDEX episodes_by_owner ON episodes (owner, bytes);
