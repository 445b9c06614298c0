-- What players reported of a game's answers beside their tokens: tokens of caches and of reasoning, the cost and how many answers have
-- one, as a JSON object. Acts of earlier versions do not tell it.
ALTER TABLE results ADD COLUMN usage text COLLATE "C" NOT NULL DEFAULT '{}';
