-- Competitions that are mended: changed, cancelled, hidden; attempts that are played again on spare seeds.

ALTER TABLE competitions ADD COLUMN cancelled_at  INTEGER;
ALTER TABLE competitions ADD COLUMN cancel_reason TEXT;
ALTER TABLE competitions ADD COLUMN hidden        INTEGER NOT NULL DEFAULT 0;  -- 1: in no list but the organizers'

ALTER TABLE runs ADD COLUMN closes_at INTEGER;           -- later than in the definition: its window was extended
ALTER TABLE runs ADD COLUMN replays   INTEGER;           -- the voided attempt that it plays again on spare seeds

ALTER TABLE entries ADD COLUMN address   TEXT;           -- the network from which it registered, for organizers
ALTER TABLE entries ADD COLUMN erased_at INTEGER;        -- its personal data were erased
ALTER TABLE entries ADD COLUMN published TEXT;           -- the name in the published file, where it was erased after the end

ALTER TABLE invitations ADD COLUMN revoked_at INTEGER;
CREATE INDEX invitations_by_competition ON invitations (competition, created_at, hash);

-- What organizers did in a competition, as far as everybody may see it.
ALTER TABLE audit ADD COLUMN competition INTEGER;        -- competitions.key
ALTER TABLE audit ADD COLUMN shown       TEXT;           -- JSON
CREATE INDEX audit_by_competition ON audit (competition, number) WHERE competition IS NOT NULL;
