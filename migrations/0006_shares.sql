-- Entering a competition reads no other entrants: how names look, and how many take part.

ALTER TABLE entries ADD COLUMN skeleton TEXT;        -- what two names have in common that look the same; added at a start
CREATE INDEX entries_by_skeleton ON entries (competition, skeleton);

ALTER TABLE competitions ADD COLUMN entrants INTEGER NOT NULL DEFAULT 0;  -- that were not excluded
UPDATE competitions SET entrants = (
    SELECT count(*) FROM entries n WHERE n.competition = competitions.key AND n.status = 'active');
