-- A name that was used once in a competition stays taken, also when its entrant has another one or was erased.

-- A keyed digest of each look of each name, until the competition is over. The key is the competition's salt. Rows of entrants
-- from before are added when the database is opened.
CREATE TABLE used_names (
    competition  INTEGER NOT NULL,
    look         BLOB    NOT NULL,
    entry        INTEGER NOT NULL,                       -- entries.key: who used it, and may take it again
    PRIMARY KEY (competition, look, entry)
) STRICT, WITHOUT ROWID;

-- Looks are those of models alone, and are compared without white space, dashes and case: they are made again.
DELETE FROM looks;

ALTER TABLE entries ADD COLUMN renames INTEGER NOT NULL DEFAULT 0;
