-- Why answers of a game did not count: how many of each kind, as a JSON object. Games of earlier versions do not tell it.
ALTER TABLE results ADD COLUMN failures TEXT NOT NULL DEFAULT '{}';
