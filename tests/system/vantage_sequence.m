% A Vantage whose receive buffer is filled by markerseek's emulator, and read by the real sender.
% VANTAGE: port on which the emulator's frames are taken, port of the search, folder of markerseek_send.m.
pkg load sockets
given = strsplit (getenv ('VANTAGE'), ',');
addpath (given{3});

function bytes = exactly (link, count)
  bytes = zeros (1, 0, 'uint8');
  while numel (bytes) < count
    [data, got] = recv (link, count - numel (bytes));
    if got <= 0
      exit (0);
    end
    bytes = [bytes, data];
  end
end

server = socket (AF_INET, SOCK_STREAM, 0);
bind (server, str2double (given{1}));
listen (server, 1);
link = accept (server);
while true
  header = exactly (link, 48);
  numbers = double (typecast (header(5:20), 'uint32'));
  if numbers(2) == 0
    opened = false;
    while ~ opened
      try
        markerseek_send ('open', '127.0.0.1', str2double (given{2}), 'emulated', 1:128, 1:2080);
        opened = true;
      catch
        pause (0.1);
      end
    end
  else
    data = exactly (link, 2 * numbers(3) * numbers(4));
    markerseek_send (reshape (typecast (data, 'int16'), numbers(4), numbers(3)));
  end
end
