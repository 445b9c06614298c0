-- Entrants with categories, terms that they accepted, a contact, and keys for each member of a team.

ALTER TABLE entries ADD COLUMN category TEXT;            -- one of those of the definition
ALTER TABLE entries ADD COLUMN terms    INTEGER;         -- the version of the terms that it accepted last
ALTER TABLE entries ADD COLUMN contact  TEXT;            -- how organizers reach it; nobody else sees it

ALTER TABLE episodes ADD COLUMN own_games INTEGER;       -- 1: its owner reads it once it has ended, also while it is sealed

ALTER TABLE keys ADD COLUMN acts_for INTEGER;            -- keys.number of the entrant's first key: it has the same rights
CREATE INDEX keys_by_team ON keys (acts_for, number) WHERE acts_for IS NOT NULL;
