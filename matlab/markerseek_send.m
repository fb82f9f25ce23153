function markerseek_send (varargin)
% Sends one frame of a Verasonics Vantage to markerseek, for each trigger of the laser.
%
%   markerseek_send ('open', host, port, probe, columns, rows)
%     Connects to a search that waits: receiver.driver = "vantage" in its rig file. probe: the name in that file.
%     columns: the receive channel of each element, Trans.Connector. rows: the samples of the acquisition,
%     Receive(1).startSample:Receive(1).endSample.
%   markerseek_send (RData)
%     Sends these rows and columns of the receive buffer: int16, samples x channels. The external function of a
%     Process calls it so, after each triggered acquisition.
%   markerseek_send ('close')
%
% Runs in MATLAB (R2020b or later), and in GNU Octave with the package sockets.
  persistent link counter probe columns rows
  if nargin == 6 && strcmp (varargin{1}, 'open')
    link = disconnected (link);
    probe = varargin{4};
    columns = varargin{5};
    rows = varargin{6};
    if isempty (probe) || numel (probe) > 20 || any (probe < 32 | probe > 126)
      error ('markerseek_send: the probe %s must have 1 to 20 characters of ASCII', probe);
    end
    link = connected (varargin{2}, varargin{3});
    counter = 0;
    transmit (link, message (counter, probe, zeros (0, 0, 'int16')));
  elseif nargin == 1 && strcmp (varargin{1}, 'close')
    link = disconnected (link);
  elseif nargin == 1 && isa (varargin{1}, 'int16')
    if isempty (link)
      error ('markerseek_send: not connected; call markerseek_send (''open'', ...) first');
    end
    frame = varargin{1};
    if max (rows) > size (frame, 1) || max (columns) > size (frame, 2)
      error ('markerseek_send: the frame has %d samples x %d channels; rows go to %d, columns to %d', ...
             size (frame, 1), size (frame, 2), max (rows), max (columns));
    end
    counter = counter + 1;
    transmit (link, message (counter, probe, frame(rows, columns)));
  else
    error ('markerseek_send: give ''open'' with host, port, probe, columns and rows, or an int16 frame, or ''close''');
  end
end

function bytes = message (counter, probe, samples)
% The header of 48 bytes, little-endian as this computer, then the samples, channel after channel.
  name = zeros (1, 20, 'uint8');
  name(1:numel (probe)) = uint8 (probe);
  numbers = uint32 ([0, counter, size(samples, 2), size(samples, 1)]);
  bytes = [uint8('MSV1'), typecast(numbers, 'uint8'), typecast(seconds_since_1970 (), 'uint8'), name, ...
           typecast(reshape (samples, 1, []), 'uint8')];
end

function now_s = seconds_since_1970 ()
  if in_octave ()
    now_s = time ();
  else
    now_s = posixtime (datetime ('now', 'TimeZone', 'UTC'));
  end
end

function link = connected (host, port)
  if in_octave ()
    pkg load sockets
    link = socket (AF_INET, SOCK_STREAM, 0);
    if connect (link, struct ('addr', host, 'port', port)) ~= 0
      disconnect (link);
      error ('markerseek_send: no search waits at %s, port %d; start it first', host, port);
    end
  else
    link = tcpclient (host, port);
  end
end

function link = disconnected (link)
  if ~ isempty (link) && in_octave ()
    disconnect (link);
  end
  link = [];
end

function transmit (link, bytes)
  if ~ in_octave ()
    write (link, bytes);
    return
  end
  while ~ isempty (bytes)
    sent = send (link, bytes(1:min (end, 2 ^ 18)));
    if sent <= 0
      error ('markerseek_send: the search has closed the connection; open it again');
    end
    bytes = bytes(sent + 1:end);
  end
end

function yes = in_octave ()
  yes = exist ('OCTAVE_VERSION', 'builtin') ~= 0;
end
