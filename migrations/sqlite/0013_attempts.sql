-- Attempts of a competition are listed page by page, whatever their number, and those that have not ended are found at once.

ALTER TABLE runs ADD COLUMN competition INTEGER;         -- competitions.key, of an attempt: that of its entry
UPDATE runs SET competition = (SELECT competition FROM entries WHERE key = runs.entry) WHERE entry IS NOT NULL;

CREATE INDEX runs_by_competition ON runs (competition, key) WHERE competition IS NOT NULL;
CREATE INDEX runs_open           ON runs (competition, key) WHERE competition IS NOT NULL AND ended_at IS NULL;
