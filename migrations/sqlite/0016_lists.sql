-- Lists of what anyone may read, and of one's own, walked through all sealed games and attempts of a large competition.

ALTER TABLE runs ADD COLUMN revealed INTEGER NOT NULL DEFAULT 0;  -- 1 once a sealed one is open to all
UPDATE runs SET revealed = 1
WHERE competition IN (SELECT key FROM competitions WHERE revealed_at IS NOT NULL);

CREATE INDEX episodes_public_by_status ON episodes (status, key)
    WHERE visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed));
CREATE INDEX episodes_public_by_task ON episodes (task, key, status)
    WHERE visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed));
CREATE INDEX episodes_public_by_model ON episodes (model, key, task, status)
    WHERE visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed));

-- The newest of one key, and as before the bytes of all.
DROP INDEX episodes_by_owner;
CREATE INDEX episodes_by_owner ON episodes (owner, key, bytes);

CREATE INDEX runs_public ON runs (key)
    WHERE visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed));
CREATE INDEX runs_public_by_status ON runs (status, key)
    WHERE visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed));
CREATE INDEX runs_public_by_model ON runs (model, key)
    WHERE visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed));
