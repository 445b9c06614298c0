-- The last places of a competition are kept for networks from which nobody entered.
CREATE INDEX entries_by_address ON entries (competition, address);
