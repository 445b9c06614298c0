-- Several servers can share a database of PostgreSQL: what they need is in migrations/postgres/0015_fleet.sql. A file of SQLite
-- belongs to one server, so its tables stay as they are.
SELECT 1;
