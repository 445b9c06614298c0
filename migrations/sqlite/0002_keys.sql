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

-- Why it ended, beside its last record, which may be large.
ALTER TABLE episodes ADD COLUMN reason TEXT;
UPDATE episodes SET reason = json_extract(ending, '$.reason') WHERE ending IS NOT NULL;

CREATE INDEX episodes_by_owner ON episodes (owner, bytes);

-- Everybody has names of their own for creations: the number of the key, a slash, the name.
UPDATE episodes SET idempotency_key = '/' || idempotency_key WHERE idempotency_key IS NOT NULL;
