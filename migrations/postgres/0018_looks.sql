-- Looks tell more names apart that look the same: those of models are made again when the database is opened, and with them the
-- digests of the names that entrants have.
DELETE FROM looks;
