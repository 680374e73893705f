// Starts a page without a player.
theme.start();
startTips();
startNavigation();
