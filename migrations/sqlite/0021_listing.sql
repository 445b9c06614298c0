-- Lists of games are sorted by what stands beside an ended game, show its course, and find games in which people took part. Rows of
-- earlier versions have it, too; where a record is damaged, `verify` finds that they differ.

ALTER TABLE episodes ADD COLUMN score  REAL;                        -- of an ended one, as its last record has it
ALTER TABLE episodes ADD COLUMN rounds REAL;                        -- all three are doubles: one query sorts by any of them
ALTER TABLE episodes ADD COLUMN seed   REAL;
ALTER TABLE episodes ADD COLUMN curve  TEXT;                        -- up to 32 scores in equal steps of rounds, as a JSON array
ALTER TABLE episodes ADD COLUMN people INTEGER NOT NULL DEFAULT 0;  -- 1 where somebody declared that a person plays

UPDATE episodes
SET rounds = CASE WHEN json_valid(ending) THEN CAST(json_extract(ending, '$.rounds') AS REAL) END,
    score = CASE WHEN json_valid(ending) THEN CASE WHEN json_extract(ending, '$.rounds') > 0 THEN CAST(json_extract(ending, '$.score') AS REAL) ELSE 0.0 END END,
    seed = CASE WHEN json_valid(opening) THEN CAST(json_extract(opening, '$.config.seed') AS REAL) END
WHERE ended_at IS NOT NULL;

UPDATE episodes
SET curve = '[0' || coalesce((
    SELECT ',' || group_concat(r.score, ',' ORDER BY r.round) FROM rounds r
    WHERE r.episode = episodes.key
      AND ((r.round + 1) % ((CAST(episodes.rounds AS INTEGER) + 29) / 30) = 0 OR r.round + 1 = episodes.rounds)), '') || ']'
WHERE ended_at IS NOT NULL;

UPDATE episodes
SET people = 1
WHERE (json_valid(opening) AND json_extract(opening, '$.agent_meta.kind') = 'human')
   OR key IN (SELECT episode FROM claims WHERE json_valid(agent_meta) AND json_extract(agent_meta, '$.kind') = 'human');

-- A list in one of these orders is read from its index, filters included. Games of one value are told apart by their time first:
-- SQLite looks up no place of an index by its integer key.
CREATE INDEX episodes_public_by_score ON episodes (score, created_at, key, task, model, status, people)
    WHERE score IS NOT NULL AND (visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed)));
CREATE INDEX episodes_public_by_rounds ON episodes (rounds, created_at, key, task, model, status, people)
    WHERE rounds IS NOT NULL AND (visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed)));
CREATE INDEX episodes_public_by_seed ON episodes (seed, created_at, key, task, model, status, people)
    WHERE seed IS NOT NULL AND (visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed)));

CREATE INDEX episodes_public_people ON episodes (created_at, key, task, model, status, ended_at, open_seats)
    WHERE people AND (visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed)));
