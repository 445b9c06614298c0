-- Entering a competition reads no other entrants: how their names and models look, and how many take part.

-- What is seen of each name and model; two that are seen alike share a look. Rows of entrants from before are added when
-- the database is opened.
CREATE TABLE looks (
    competition  INTEGER NOT NULL,
    kind         TEXT    NOT NULL,                       -- name model
    look         TEXT    NOT NULL,
    written      TEXT    NOT NULL,                       -- as the entrant writes it
    PRIMARY KEY (competition, kind, look, written)
) STRICT, WITHOUT ROWID;

ALTER TABLE competitions ADD COLUMN entrants INTEGER NOT NULL DEFAULT 0;  -- that were not excluded
UPDATE competitions SET entrants = (
    SELECT count(*) FROM entries n WHERE n.competition = competitions.key AND n.status = 'active');
