-- Lists of games are sorted by what stands beside an ended game, show its course, and find games in which people took part. Rows of
-- earlier versions have it, too. Their records are read as texts: some may be damaged, and these fields come first in them.

ALTER TABLE episodes ADD COLUMN score  double precision;                -- of an ended one, as its last record has it
ALTER TABLE episodes ADD COLUMN rounds double precision;                -- all three are doubles: one query sorts by any of them
ALTER TABLE episodes ADD COLUMN seed   double precision;
ALTER TABLE episodes ADD COLUMN curve  text COLLATE "C";                -- up to 32 scores in equal steps of rounds, as a JSON array
ALTER TABLE episodes ADD COLUMN people boolean NOT NULL DEFAULT false;  -- true where somebody declared that a person plays

UPDATE episodes
SET rounds = substring(ending FROM '"rounds":([0-9]{1,9})')::double precision,
    score = CASE WHEN ending LIKE '%"rounds":0,%' THEN 0
                 ELSE substring(ending FROM '"score":(-?[0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]{1,2})?)')::double precision END,
    seed = substring(opening FROM '"seed":([0-9]{1,18})')::double precision
WHERE ended_at IS NOT NULL;

UPDATE episodes
SET curve = '[0' || coalesce((
    SELECT ',' || string_agg(r.score::text, ',' ORDER BY r.round) FROM rounds r
    WHERE r.episode = episodes.key
      AND ((r.round + 1) % greatest((episodes.rounds::bigint + 29) / 30, 1) = 0 OR r.round + 1 = episodes.rounds)), '') || ']'
WHERE ended_at IS NOT NULL;

CREATE FUNCTION swarmbench_is_human(record text, VARIADIC path text[]) RETURNS boolean LANGUAGE plpgsql AS $$
BEGIN
    RETURN coalesce(record LIKE '%"human"%' AND record::json #>> path = 'human', false);
EXCEPTION WHEN others THEN
    RETURN false;
END $$;

UPDATE episodes
SET people = true
WHERE swarmbench_is_human(opening, 'agent_meta', 'kind')
   OR key IN (SELECT episode FROM claims WHERE swarmbench_is_human(agent_meta, 'kind'));

-- A temporary function would be dropped by a commit as its session ends, and a commit may wait for a standby.
DROP FUNCTION swarmbench_is_human;

-- A list in one of these orders is read from its index, filters included.
CREATE INDEX episodes_public_by_score ON episodes (score, created_at, key, task, model, status, people)
    WHERE score IS NOT NULL AND (visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed)));
CREATE INDEX episodes_public_by_rounds ON episodes (rounds, created_at, key, task, model, status, people)
    WHERE rounds IS NOT NULL AND (visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed)));
CREATE INDEX episodes_public_by_seed ON episodes (seed, created_at, key, task, model, status, people)
    WHERE seed IS NOT NULL AND (visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed)));

CREATE INDEX episodes_public_people ON episodes (created_at, key, task, model, status, ended_at, open_seats)
    WHERE people AND (visibility = 'public' OR (ended_at IS NOT NULL AND (visibility <> 'sealed' OR revealed)));
