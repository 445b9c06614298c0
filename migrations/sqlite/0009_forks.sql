-- Forks: episodes that continue another one from a round. Their journal has the rounds before it, too.
ALTER TABLE episodes ADD COLUMN fork_of INTEGER;         -- episodes.key of the other, its parent
ALTER TABLE episodes ADD COLUMN fork_round INTEGER;      -- how many rounds of the parent were taken over
CREATE INDEX episodes_by_fork ON episodes (fork_of, key) WHERE fork_of IS NOT NULL;

-- Forks whose rounds are being written, in several commits; their rows in `episodes` come last. What is left of them here
-- when the database is opened has no such row and never will: its acts and rounds are deleted.
CREATE TABLE forking (
    episode  INTEGER PRIMARY KEY
) STRICT;
