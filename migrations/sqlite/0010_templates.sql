-- Large prompt templates are stored once, and not in the opening of every episode: most of a small game was its template,
-- and rows of episodes were longer than a page. Openings of earlier versions are whole, and stay so.
CREATE TABLE templates (
    key   INTEGER PRIMARY KEY,
    hash  BLOB    NOT NULL UNIQUE,                   -- SHA-256 of the text
    text  TEXT    NOT NULL                           -- as it is in openings: what a JSON string has between its quotes
) STRICT;

ALTER TABLE episodes ADD COLUMN template INTEGER;        -- templates.key of what was cut out of `opening`; none: it is whole
ALTER TABLE episodes ADD COLUMN template_at INTEGER;     -- before which character of `opening` it belongs, from 0

-- What was read from the records by JSON functions. Rows of earlier versions have NULL, and their records are read.
ALTER TABLE acts ADD COLUMN source INTEGER;              -- who decided: 0 a player, 1 the clock
ALTER TABLE episodes ADD COLUMN open_seats INTEGER;      -- 1 where seats could be claimed

-- What lists are filtered by beside these is read from the index, and not from the rows.
DROP INDEX episodes_by_task;
DROP INDEX episodes_by_model;
CREATE INDEX episodes_by_task  ON episodes (task, key, status);
CREATE INDEX episodes_by_model ON episodes (model, key, task, status);

-- What anyone may read, for lists that would walk through all sealed games of a competition.
CREATE INDEX episodes_public ON episodes (key)
    WHERE visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed));
-- Games of runs that are played: few at any time.
CREATE INDEX episodes_open ON episodes (run, key) WHERE ended_at IS NULL AND voided_at IS NULL;
