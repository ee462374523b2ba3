-- The owner of worlds that a server has handed back, because it cannot run them: a member whose lease is always over, so that any server
-- with room takes them over. Servers of earlier versions take it for one that is gone.
INSERT INTO members (kind, address, expires_at) VALUES ('server', '', '-infinity');
